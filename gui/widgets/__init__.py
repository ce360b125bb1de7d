"""Widgets of the window, in Open3D."""
