"""What the toolkit lacks: X11 keyboards and screens, Vulkan devices, redraws, closing."""
