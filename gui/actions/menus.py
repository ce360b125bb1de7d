"""The menu bar: its items, their shortcuts, and what must be open for them."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from open3d.visualization import gui

from gui.widgets.picture import text_room


@dataclass(frozen=True)
class Item:
    """An item of a menu."""

    key: str
    label: str  # what it does; ends with "..." if it asks for more first
    shortcut: str = ""
    # what must be open: "open" a take or a stream, "take" a take, "splats" one in which something is trained, ""
    # nothing: only these act while the start page covers the open take or stream
    needs: str = "open"

    @property
    def words(self) -> str:
        """The label without dots."""
        return self.label.removesuffix("...")

    @property
    def text(self) -> str:
        """The label with the shortcut, as the menu shows it."""
        return f"{self.label} ({self.shortcut})" if self.shortcut else self.label


MENUS: dict[str, tuple[Item | None, ...]] = {  # by title; None is a line between items
    "File": (
        Item("new", "New take from footage...", needs=""),
        Item("open", "Open take, stream or cast...", needs=""),
        Item("address", "Open stream from URL...", needs=""),
        None,
        Item("screenshot", "Save screenshot..."),
        Item("report", "Write HTML report", needs="take"),
        None,
        Item("preferences", "Preferences...", needs=""),
        Item("quit", "Quit", needs=""),
    ),
    "Edit": (
        Item("undo", "Undo", "Ctrl+Z"),
        Item("redo", "Redo", "Ctrl+Shift+Z"),
        None,
        Item("edit", "Trim, crop, clean", "X", needs="take"),
    ),
    "View": (
        Item("reset", "Reset view", "R"),
        Item("camera", "Next capture camera", "C"),
        Item("span", "Select span: from here, to here, none", "T"),
        None,
        Item("scene", "Scene: splats, cameras, points", "O", needs="splats"),
        None,
        Item("worst", "Worst frames by camera...", needs="take"),
        Item("queue", "Queue of takes", "Q", needs=""),
        None,
        Item("start", "Start page", "H", needs=""),
        Item("figures", "Inspector and log", "I"),
        Item("log", "Job log, large", "J"),
        Item("log_warnings", "Job log: warnings only, all lines"),
        Item("fullscreen", "Fullscreen", "F", needs=""),
    ),
    "Mark": (
        Item("mark", "Mark frame...", "M"),
        Item("next_mark", "Next mark", ">"),
        Item("previous_mark", "Previous mark", "<"),
        Item("marks", "All marks..."),
    ),
    "Export": (
        Item("export", "Export...", needs="splats"),
        None,
        Item("path", "Camera path editor", "P"),
        Item("add_key", "Add view to camera path", "K", needs="splats"),
        Item("read_keys", "Camera path from file...", needs="splats"),
        Item("clear_keys", "Clear camera path"),
        None,
        Item("stop_export", "Stop export", needs=""),
    ),
    "Share": (
        Item("share folder", "Folder for a web server..."),
        Item("share single-file", "Single HTML file..."),
        None,
        Item("serve", "Serve with QR code..."),
        Item("stop_serving", "Stop serving", needs=""),
    ),
    "Help": (
        Item("stage_help", "What to look for", "F1"),
        None,
        Item("search", "Find a command...", "Ctrl+K", needs=""),
        Item("shortcuts", "Shortcuts", "?", needs=""),
        None,
        Item("about", "About", needs=""),
    ),
}

ITEMS = {item.key: item for items in MENUS.values() for item in items if item is not None}

ROW, SEPARATOR, MARGINS, WIDER = 1.52, 0.4, 0.4, 6.6
"""Heights in a menu, and its width beyond its longest item, in font sizes, measured: the toolkit draws menus itself."""


def boxes(em: float) -> list[tuple[float, float]]:
    """(width, height) of the menus in pixels; `em` is the font size."""
    found = []
    for entries in MENUS.values():
        items = [item for item in entries if item is not None]
        height = MARGINS + ROW * len(items) + SEPARATOR * (len(entries) - len(items))
        found.append((WIDER * em + max(text_room(item.text, em) for item in items), height * em))
    return found


def build(application: gui.Application) -> None:
    """Create the application's menu bar, once."""
    if application.menubar is not None:
        return
    bar, numbers = gui.Menu(), {key: number for number, key in enumerate(ITEMS, start=1)}
    for title, entries in MENUS.items():
        menu = gui.Menu()
        for item in entries:
            if item is None:
                menu.add_separator()
            else:
                menu.add_item(item.text, numbers[item.key])
        bar.add_menu(title, menu)
    application.menubar = bar


def connect(window: gui.Window, chosen: Callable[[str], None]) -> None:
    """Report the key of each chosen item."""
    for number, item in enumerate(ITEMS.values(), start=1):
        window.set_on_menu_item_activated(number, partial(chosen, item.key))
