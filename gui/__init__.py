"""What an operator sees and touches. Widgets in `panels`, state in `presenters` (no Open3D there)."""
