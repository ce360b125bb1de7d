"""What the window shows and what a click does, as plain objects: no Open3D here, so all of it is tested without."""
