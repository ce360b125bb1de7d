"""Counts as text."""

from __future__ import annotations


def counted(count: float, noun: str) -> str:
    """A count with its noun: "1 frame", "1,200 frames"."""
    return f"{count:,} {plural(noun, count)}"


def plural(noun: str, count: float) -> str:
    """The noun alone, as its count wants it: "frame" for 1, else "frames"."""
    return noun if count == 1 else f"{noun}s"
