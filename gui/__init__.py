"""The window. Widgets are in `panels`, state is in `presenters` (which do not use Open3D)."""
