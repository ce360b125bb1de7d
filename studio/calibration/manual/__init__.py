"""Calibration from points marked by hand."""
