"""The menu bar: its items, and the key of each item's action."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

from open3d.visualization import gui

from gui.widgets.picture import text_room

MENUS: tuple[tuple[str, tuple[tuple[str, str], ...]], ...] = (
    (
        "File",
        (
            ("new", "New take from footage..."),
            ("open", "Open take or stream..."),
            ("address", "Open stream from URL..."),
            ("", ""),
            ("screenshot", "Save screenshot..."),
            ("report", "Write HTML report"),
            ("", ""),
            ("preferences", "Preferences..."),
            ("quit", "Quit"),
        ),
    ),
    ("Edit", (("undo", "Undo (Ctrl+Z)"), ("redo", "Redo (Ctrl+Shift+Z)"), ("", ""), ("edit", "Trim, crop, clean (X)"))),
    (
        "View",
        (
            ("reset", "Reset view (R)"),
            ("background", "Next background (B)"),
            ("camera", "Next capture camera (C)"),
            ("span", "Select span: from here, to here, none (T)"),
            ("", ""),
            ("scene", "Scene: splats, cameras, points (O)"),
            ("", ""),
            ("cameras", "Cameras: use, hold out..."),
            ("bakes", "Bakes: compare, keep..."),
            ("queue", "Queue of takes (Q)"),
            ("", ""),
            ("start", "Start page (H)"),
            ("figures", "Inspector and log (I)"),
            ("log", "Job log, large (J)"),
            ("log_warnings", "Job log: warnings only, all lines"),
            ("fullscreen", "Fullscreen (F)"),
        ),
    ),
    (
        "Mark",
        (
            ("mark", "Mark frame... (M)"),
            ("next_mark", "Next mark (>)"),
            ("previous_mark", "Previous mark (<)"),
            ("marks", "All marks..."),
        ),
    ),
    (
        "Export",
        (
            ("export", "Export..."),
            ("", ""),
            ("path", "Camera path editor (P)"),
            ("add_key", "Add view to camera path (K)"),
            ("clear_keys", "Clear camera path"),
            ("", ""),
            ("stop_export", "Stop export"),
        ),
    ),
    (
        "Share",
        (
            ("share folder", "Folder for a web server..."),
            ("share single-file", "Single HTML file..."),
            ("", ""),
            ("serve", "Serve with QR code..."),
            ("stop_serving", "Stop serving"),
        ),
    ),
    (
        "Help",
        (
            ("stage_help", "What to look for (F1)"),
            ("", ""),
            ("search", "Find a command... (Ctrl+K)"),
            ("shortcuts", "Shortcuts (?)"),
            ("", ""),
            ("about", "About"),
        ),
    ),
)


ROW, SEPARATOR, MARGINS, WIDER = 1.52, 0.4, 0.4, 6.6
"""Heights in a menu, and by how much it is wider than its longest item, in font sizes, measured: the toolkit draws
menus unasked."""


def boxes(em: float) -> list[tuple[float, float]]:
    """(width, height) of the menus in pixels; `em` is the font size."""
    found = []
    for _, entries in MENUS:
        rows = sum(bool(key) for key, _ in entries)
        height = MARGINS + ROW * rows + SEPARATOR * (len(entries) - rows)
        found.append((WIDER * em + max(text_room(label, em) for _, label in entries), height * em))
    return found


def build(application: gui.Application) -> None:
    """Create the application's menu bar, once."""
    if application.menubar is not None:
        return
    bar = gui.Menu()
    number = 1
    for title, entries in MENUS:
        menu = gui.Menu()
        for key, label in entries:
            if key:
                menu.add_item(label, number)
                number += 1
            else:
                menu.add_separator()
        bar.add_menu(title, menu)
    application.menubar = bar


class MenuStates:
    """Keeps items of the menu bar gray that are not possible now.

    Args:
        why_not: why the action of a key of `MENUS` is not possible now; "" if it is.
    """

    def __init__(self, why_not: Callable[[str], str]) -> None:
        self._why_not = why_not
        self._possible: dict[int, bool] = {}

    def update(self, bar: gui.Menu | None) -> bool:
        """Call before the window is drawn, with the menu bar; returns whether an item has changed."""
        if bar is None:
            return False
        before = self._possible
        self._possible = {number: not self._why_not(key) for number, key in _numbers()}
        changed = [number for number, on in self._possible.items() if before.get(number, True) != on]
        for number in changed:
            bar.set_enabled(number, self._possible[number])
        return bool(changed)


def _numbers() -> Iterator[tuple[int, str]]:
    """The numbers of the items in the toolkit, and their keys."""
    return enumerate((key for _, entries in MENUS for key, _ in entries if key), start=1)


def connect(window: gui.Window, chosen: Callable[[str], None]) -> None:
    """Report the key of each chosen item."""
    for number, key in _numbers():
        window.set_on_menu_item_activated(number, partial(chosen, key))
