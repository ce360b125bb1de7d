"""A file dialog: path, list, Up, Home. Open takes the selected entry."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from open3d.visualization import gui

from v3studio.gui.drawing.palette import ACCENT
from v3studio.gui.models.folders import FolderList, Kind
from v3studio.gui.widgets.dialogs.base import Dialogs, filled, in_lines
from v3studio.gui.widgets.picture import make_label

ROWS = 12


def ask_path(
    dialogs: Dialogs,
    title: str,
    start: Path,
    wanted: str,
    done: Callable[[str], None],
    cancelled: Callable[[], None] = lambda: None,
    endings: Sequence[str] = (),
) -> None:
    """Show the dialog; `wanted` and `endings` as in `FolderList`. `done` is called with the path after the dialog has
    closed, `cancelled` if it is closed without a path."""
    _PathDialog(dialogs, FolderList(start, wanted, endings), done, cancelled).show(title)


class _PathDialog:
    def __init__(
        self, dialogs: Dialogs, folders: FolderList, done: Callable[[str], None], cancelled: Callable[[], None]
    ) -> None:
        self._dialogs, self._found, self._done, self._cancelled = dialogs, folders, done, cancelled
        self._typed = str(folders.folder)
        self._marked: Path | None = None
        self._path = gui.TextEdit()
        self._path.set_on_text_changed(self._type)
        self._list = dialogs.list_of(ROWS, self._select)
        self._message = dialogs.label("\n")
        # the toolkit draws the selected row of a list gray on gray, and has no other color for it
        self._selected = make_label(" ", ACCENT)

    def show(self, title: str) -> None:
        dialogs, em = self._dialogs, self._dialogs.em
        path = gui.Horiz(0.4 * em)
        for key, label, action in (("up", "Up", self._found.up), ("home", "Home", self._home)):
            button = dialogs.button(key, label, partial(self._moved, action))
            button.vertical_padding_em = 0
            path.add_child(button)
        path.add_child(self._path)
        hint = {
            Kind.FOLDER: "Select a folder, or double-click to enter it. Open alone uses the current folder.",
            Kind.TAKE: "Select one and press Open. Double-click to enter a folder.",
            Kind.FILE: "Select a file and press Open. Double-click to enter a folder.",
        }[self._found.wanted]
        parts: list[gui.Widget] = [path, self._list, self._selected, dialogs.label(hint), self._message]
        answers = [("open", "Open", self._open), ("close", "Cancel", self._close)]
        dialogs.show("path", title, parts, answers, 170, self._enter)
        dialogs.widgets |= {"path": self._path, "list": self._list, "selected": self._selected}
        self._fill()
        dialogs.focus(self._path)

    def _fill(self) -> None:
        folders = self._found
        self._mark(None)
        self._typed = str(folders.folder)
        self._path.text_value = self._typed
        labels = [entry.label for entry in folders.entries]
        self._list.set_items(filled(labels, ROWS))
        self._list.selected_index = -1
        self._say()

    def _say(self) -> None:
        self._message.text = in_lines(self._found.message, 2)

    def _home(self) -> None:
        self._found.enter(Path.home())

    def _mark(self, path: Path | None) -> None:
        """Select an entry of the list, or none."""
        self._marked = path
        self._selected.text = " " if path is None else f"Selected: {path.name}"

    def _moved(self, action: Callable[[], object]) -> None:
        action()
        self._fill()

    def _type(self, text: str) -> None:
        self._typed = text
        self._mark(None)

    def _select(self, _label: str, twice: bool) -> None:
        number = self._list.selected_index
        if not 0 <= number < len(self._found.entries):
            return
        path = self._found.entries[number].path
        self._mark(path)
        if twice:
            self._take(path, twice=True)

    def _open(self) -> None:
        self._take(self._marked or Path(self._typed.strip() or self._found.folder))

    def _enter(self) -> None:
        """Handle Enter: go to a typed folder and list it; otherwise like Open."""
        typed, folders = Path(self._typed.strip() or ".").expanduser(), self._found
        if self._marked is None and typed != folders.folder and typed.is_dir() and folders.wanted == Kind.FOLDER:
            self._moved(lambda: self._found.enter(typed.absolute()))
        else:
            self._open()

    def _take(self, path: Path, twice: bool = False) -> None:
        before = self._found.folder
        chosen = self._found.choose(path, twice)
        if chosen is not None:
            self._dialogs.close()
            self._dialogs.preferences.keep(folder=str(before))
            self._done(str(chosen))
        elif self._found.folder != before:
            self._fill()
        else:
            self._say()

    def _close(self) -> None:
        self._dialogs.close()
        self._cancelled()
