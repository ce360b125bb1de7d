"""The scene: splats, cameras, points, mesh and guides in one picture, hidden and shown by depth."""
