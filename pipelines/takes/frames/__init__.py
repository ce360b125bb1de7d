"""Frames and their groups: numbers, files, and frames with the take's edits."""
