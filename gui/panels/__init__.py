"""The widgets that show what the presenters hold. Open3D is imported here and in `gui.viewport` and `gui.app` only."""
