"""The list of shortcuts shown by `?`."""

from __future__ import annotations

SHORTCUTS: tuple[tuple[str, str], ...] = (
    ("Space", "play or pause"),
    ("Left, Right", "step one frame back or forward"),
    ("Home, End", "go to the first or last frame"),
    ("[ and ]", "go to the previous or next group"),
    ("1, 2, 3, 4", "show footage, trained, decoded, the other bake"),
    ("S", "side by side"),
    ("W", "wipe; drag the line"),
    ("D", "difference heat map"),
    ("C", "look through the next capture camera"),
    ("Z", "zoom to the performer in a capture camera's image; press again for the whole image"),
    ("R", "reset the view"),
    ("B", "next background: dark, black, white"),
    ("L", "toggle looping"),
    ("V", "sound off or on"),
    ("M", "mark the frame, with a note"),
    ("< and >", "go to the previous or next mark"),
    ("Ctrl+Z, Ctrl+Shift+Z", "undo, redo a change of settings, marks or edits"),
    ("K, P", "add the view to the camera path; show the editor of the path"),
    ("F", "fullscreen viewport (Escape exits)"),
    ("I", "show or hide the inspector and log"),
    ("Q", "show the queue of takes"),
    ("X", "edit the take: trim, crop, remove floaters, place the world"),
    ("N, E, Delete, U, A", "points by hand: new, edit, remove mark, undo, toggle snapping"),
    ("Up, Down", "points by hand: select a point"),
    ("?", "show this list"),
    ("Click, right click", "on a camera: look through it; its menu"),
    ("Left drag", "orbit"),
    ("Right drag, Shift + drag", "pan"),
    ("Wheel", "zoom"),
)


def shortcuts_text() -> str:
    """One line per shortcut."""
    return "\n".join(f"{keys}:  {what}" for keys, what in SHORTCUTS)
