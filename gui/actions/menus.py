"""The menu bar: what its items have, their size, and drawing them."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum, auto
from typing import Any, Generic, TypeVar

from open3d.visualization import gui

from v3studio.gui.platform.menu_bar import TITLE_ENDS
from v3studio.gui.widgets.picture import text_room

Acting = TypeVar("Acting")


class Needs(Enum):
    """The kinds of what must be open for a command; only those that need nothing act while the start page covers it."""

    NOTHING = auto()
    STREAM = auto()  # a take or a stream
    TAKE = auto()
    SPLATS = auto()  # a take or a stream in which something is trained


@dataclass(frozen=True)
class Item(Generic[Acting]):
    """An item of a menu."""

    key: str
    label: str  # what it does; ends with "..." if it asks for more first
    act: Callable[[Acting], object]
    shortcut: str = ""
    needs: Needs = Needs.STREAM
    # what else it needs, as a value that is true if it is there, and what is said if it is not
    lacks: tuple[Callable[[Acting], object], str] | None = None

    @property
    def words(self) -> str:
        """The label without dots."""
        return self.label.removesuffix("...")

    @property
    def text(self) -> str:
        """The label with the shortcut, as the menu shows it."""
        return f"{self.label} ({self.shortcut})" if self.shortcut else self.label


Menus = Mapping[str, Sequence[Item[Any] | None]]
"""Items by title of the menu; None is a line between them."""

ROW, SEPARATOR, MARGINS, FIRST, WIDER = 1.52, 0.4, 0.4, 1.31, 6.6
"""Heights in a menu, the middle of its first item, and its width beyond its longest item, in font sizes, measured: the
toolkit draws menus itself."""


def boxes(menus: Menus, em: float) -> list[tuple[float, float]]:
    """(width, height) of the menus in pixels; `em` is the font size."""
    sizes = []
    for entries in menus.values():
        items = [item for item in entries if item is not None]
        height = MARGINS + ROW * len(items) + SEPARATOR * (len(entries) - len(items))
        sizes.append((WIDER * em + max(text_room(item.text, em) for item in items), height * em))
    return sizes


def places(menus: Menus, em: float) -> dict[str, tuple[float, float]]:
    """Places of the titles and of the open menu's items, by title or key: pixels right of and below the upper left
    corner of the window's content; `em` is the font size."""
    where: dict[str, tuple[float, float]] = {}
    for (title, entries), left, right in zip(menus.items(), (0.0, *TITLE_ENDS), TITLE_ENDS, strict=False):
        across, down = (left + right) / 2 * em, FIRST * em
        where[title] = across, -0.75 * em
        for item in entries:
            if item is not None:
                where[item.key] = across + em, down
            down += (SEPARATOR if item is None else ROW) * em
    return where


def build(application: gui.Application, menus: Menus) -> None:
    """Create the application's menu bar."""
    bar, number = gui.Menu(), 0
    for title, entries in menus.items():
        menu = gui.Menu()
        for item in entries:
            if item is None:
                menu.add_separator()
            else:
                number += 1
                menu.add_item(item.text, number)
        bar.add_menu(title, menu)
    application.menubar = bar
