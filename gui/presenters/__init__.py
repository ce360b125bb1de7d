"""What the window shows and what clicks do, as plain objects. Nothing here uses Open3D, so tests need no window."""
