"""Exports of takes and streams in other programs' formats."""

DEFAULT_OF = "decoded"
"""The frames of a take that are exported by default, also in the window: those that a player shows."""
