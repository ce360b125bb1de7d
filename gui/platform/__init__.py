"""X11 keyboards and screens, Vulkan devices, closing: what the toolkit lacks."""
