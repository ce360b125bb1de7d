"""Exports of takes and streams in other programs' formats."""

DEFAULT_OF = "decoded"
"""Which frames of a take are exported by default: those that a player shows. Also the default in the window."""
