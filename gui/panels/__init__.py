"""Widgets that show the state of the presenters. Open3D is imported only here, in `gui.viewport` and in `gui.app`."""
