"""FolderList, the model of a file dialog: current folder, entries, and what choosing one does."""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

from v3studio.studio.capture.patterns import natural_key

MOST_ENTRIES = 1000  # longer lists are truncated; any path can be typed


class Kind(StrEnum):
    """The kind of a path, or of what is wanted: `TAKE` is then the folder of a take or of a stream."""

    FOLDER = "folder"
    TAKE = "take"
    STREAM = "stream"
    FILE = "file"


@dataclass(frozen=True)
class Entry:
    """A line of the list."""

    path: Path
    kind: Kind

    @property
    def label(self) -> str:
        if self.kind == Kind.FILE:
            return self.path.name
        return f"{self.path.name}/" + (f"   ({self.kind})" if self.kind != Kind.FOLDER else "")


class FolderList:
    """The folder that a file dialog shows.

    Args:
        start: folder to start in, or a path in it; if it does not exist, its nearest existing parent.
        wanted: one of `Kind`.
        endings: extensions of files that can be chosen; none: all, if files are wanted.

    `entries` are folders first, in natural order (cam2 before cam10). `message`: why the last action failed; "" if it
    succeeded.
    """

    def __init__(self, start: Path, wanted: str, endings: Sequence[str] = ()) -> None:
        self.wanted, self.endings = Kind(wanted), tuple(endings)
        self.entries: list[Entry] = []
        self.message = ""
        start = start.expanduser().absolute()
        self.folder = next((path for path in (start, *start.parents) if path.is_dir()), Path("/"))
        self.enter(self.folder)

    def enter(self, folder: Path) -> bool:
        """Enter a folder; return False and set `message` if it cannot be read."""
        self.message = ""
        try:
            with os.scandir(folder) as scan:
                names = [(entry.name, entry.is_dir()) for entry in scan if not entry.name.startswith(".")]
        except OSError as error:
            self.message = f"{folder}: cannot be read ({error.strerror}). Choose another folder."
            return False
        self.folder = folder
        folders = sorted((name for name, is_folder in names if is_folder), key=_in_any_case)
        files = sorted((name for name, is_folder in names if not is_folder and self._fits(name)), key=_in_any_case)
        shown = folders[:MOST_ENTRIES]
        self.entries = [Entry(folder / name, kind_of(folder / name)) for name in shown]
        self.entries += [Entry(folder / name, Kind.FILE) for name in files[: MOST_ENTRIES - len(shown)]]
        if len(folders) + len(files) > MOST_ENTRIES:
            self.message = f"Only the first {MOST_ENTRIES} entries are listed. Type the path to choose another."
        return True

    def up(self) -> None:
        self.enter(self.folder.parent)

    def choose(self, path: Path, twice: bool = False) -> Path | None:
        """The path to open when an entry is chosen (`twice`: by a double click); None if that enters a folder."""
        path = path.expanduser()
        path = path if path.is_absolute() else self.folder / path
        if not path.exists():
            self.message = f"{path}: no such {Kind.FILE if self.wanted == Kind.FILE else Kind.FOLDER}. Choose another."
            return None
        if not path.is_dir():
            if self.wanted == Kind.FILE or self._fits(path.name) or path.name in ("take.json", "manifest.json"):
                return path
            self.message = f"{path}: not a folder. Choose a folder."
            return None
        kind = kind_of(path)
        if self.wanted == Kind.FOLDER and not twice:
            return path
        if self.wanted == Kind.TAKE and kind != Kind.FOLDER:
            return path
        inside = path == self.folder
        if self.enter(path) and inside:
            self.message = {
                Kind.TAKE: f"{path}: neither a take nor a stream. Choose one of its folders, or go up.",
                Kind.FILE: "Select a file, or type its name.",
            }.get(self.wanted, "")
        return None

    def _fits(self, name: str) -> bool:
        return (self.wanted == Kind.FILE and not self.endings) or name.lower().endswith(self.endings)


def kind_of(folder: Path) -> Kind:
    """The kind of a folder."""
    if (folder / "take.json").is_file():
        return Kind.TAKE
    return Kind.STREAM if (folder / "manifest.json").is_file() else Kind.FOLDER


def _in_any_case(name: str) -> list[tuple[int, int, str]]:
    return natural_key(name.lower())
