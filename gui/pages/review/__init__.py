"""The page Review: edits."""
