"""The window. Widgets are in `widgets`, state is in `models` (which do not use Open3D)."""
