"""The page Bake."""
