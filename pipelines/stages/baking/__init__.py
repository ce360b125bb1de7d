"""Baking: planning the groups of the stream, encoding them, and publishing the stream."""
