"""Marking points by hand."""
