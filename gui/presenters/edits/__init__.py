"""Trim, crop, clean and place a take: what the viewport shows, its handles, and changes with undo."""
