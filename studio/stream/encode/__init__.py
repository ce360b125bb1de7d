"""Encoding: groups of Gaussians to the files of a stream."""
