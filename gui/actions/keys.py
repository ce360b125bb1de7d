"""Keys and what they do; the list that `?` shows is made of the same."""

from __future__ import annotations

SHORTCUTS: tuple[tuple[str, str], ...] = (
    ("Space", "play or pause"),
    ("Left, Right", "one frame back or on"),
    ("Home, End", "first or last frame"),
    ("[ and ]", "previous or next group"),
    ("1, 2, 3", "ground truth, trained, decoded"),
    ("S", "side by side"),
    ("W", "wipe; drag its line"),
    ("D", "heat map of the difference"),
    ("C", "next capture camera"),
    ("Z", "bring the performer near, in a capture camera's image; again: the whole image"),
    ("R", "reset the view"),
    ("B", "background: dark, black, white"),
    ("L", "loop"),
    ("M", "mark the frame with a note"),
    ("< and >", "previous or next mark"),
    ("K", "add this view to the camera path of a movie"),
    ("F", "fullscreen: the viewport alone (Escape ends it)"),
    ("I", "figures and log, on the right; a narrow window begins without them"),
    ("N, E, Delete, U, A", "points by hand: a new point, its name and place, not in this camera, undo, snapping"),
    ("Up, Down", "points by hand: choose a point"),
    ("?", "this list"),
    ("Left drag", "turn"),
    ("Right drag, Shift + drag", "move"),
    ("Wheel", "nearer or farther"),
)


def shortcuts_text() -> str:
    """A line a key."""
    return "\n".join(f"{keys}:  {what}" for keys, what in SHORTCUTS)
