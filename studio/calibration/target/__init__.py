"""Calibration from ChArUco targets."""
