"""The menu bar: what stands in it, and which action each entry names."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

from open3d.visualization import gui

MENUS: tuple[tuple[str, tuple[tuple[str, str], ...]], ...] = (
    (
        "File",
        (
            ("new", "New take from footage..."),
            ("open", "Open take or stream..."),
            ("recent", "Open recent..."),
            ("address", "Open stream at an address..."),
            ("", ""),
            ("screenshot", "Save a screenshot..."),
            ("report", "Write the HTML report"),
            ("", ""),
            ("preferences", "Preferences..."),
            ("quit", "Quit"),
        ),
    ),
    (
        "View",
        (
            ("reset", "Reset view (R)"),
            ("background", "Next background (B)"),
            ("camera", "Next capture camera (C)"),
            ("fullscreen", "Fullscreen (F)"),
            ("figures", "Figures and log (I)"),
        ),
    ),
    (
        "Mark",
        (
            ("mark", "Mark this frame... (M)"),
            ("next_mark", "Next mark (>)"),
            ("previous_mark", "Previous mark (<)"),
            ("marks", "All marks..."),
        ),
    ),
    (
        "Export",
        (
            ("export ply", "PLY, a file a frame..."),
            ("export spz", "SPZ, a file a frame..."),
            ("export glb", "GLB, a file a frame..."),
            ("export videogs", "VideoGS layout..."),
            ("", ""),
            ("export turntable", "Movie: turntable..."),
            ("add_key", "Add this view to the camera path (K)"),
            ("clear_keys", "Clear the camera path"),
            ("export camera-path", "Movie: along the camera path..."),
            ("", ""),
            ("stop_export", "Stop the export"),
        ),
    ),
    ("Help", (("shortcuts", "Shortcuts (?)"), ("about", "About"))),
)


def build(application: gui.Application) -> None:
    """Give the application its menu bar, once."""
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


def connect(window: gui.Window, actions: Mapping[str, Callable[[], object]], after: Callable[[], None]) -> None:
    """Let the entries do their actions."""
    keys = [key for _, entries in MENUS for key, _ in entries if key]

    def run(key: str) -> None:
        actions[key]()
        after()

    for number, key in enumerate(keys, start=1):
        window.set_on_menu_item_activated(number, partial(run, key))
