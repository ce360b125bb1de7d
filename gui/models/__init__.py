"""State and images of the window, without Open3D."""
