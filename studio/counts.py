"""Counts as text."""

from __future__ import annotations

from collections.abc import Collection


def counted(count: float, noun: str) -> str:
    """A count with its noun: "1 frame", "1,200 frames"."""
    return f"{count:,} {plural(noun, count)}"


def plural(noun: str, count: float) -> str:
    """The noun alone, as its count wants it: "frame" for 1, else "frames"."""
    return noun if count == 1 else f"{noun}s"


def listed(words: Collection[str], most: int = 6) -> str:
    """Words in a sentence: "a", "a and b", or "a, b and 4 more" after the first `most`."""
    shown, more = list(words)[:most], len(words) - most
    parts = [*shown, f"{more} more"] if more > 0 else shown
    return "".join(parts) if len(parts) < 2 else f"{', '.join(parts[:-1])} and {parts[-1]}"


def cameras_listed(names: Collection[str], noun: str = "camera") -> str:
    """Cameras in a sentence: "camera 'a'", "cameras 'a' and 'b'"."""
    quoted = [f"'{name}'" for name in names]
    return f"{plural(noun, len(names))} {listed(quoted)}"
