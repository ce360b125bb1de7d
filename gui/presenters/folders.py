"""FolderList: the folder that a dialog is in, what of it can be chosen, and what choosing means."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

MOST_ENTRIES = 1000
"""A longer list is cut; what is missing in it can be typed."""


@dataclass(frozen=True)
class Entry:
    """A line of the list.

    Attributes:
        path: absolute.
        kind: "folder", "take", "stream" or "file".
    """

    path: Path
    kind: str

    @property
    def label(self) -> str:
        """As it stands in the list."""
        if self.kind == "file":
            return self.path.name
        return f"{self.path.name}/" + (f"   ({self.kind})" if self.kind != "folder" else "")


class FolderList:
    """See the module.

    Args:
        start: folder to begin in, or a path in it; the nearest folder that is there is taken.
        wanted: "folder" (any), "take" (of a take or of a stream) or "file".
        endings: of files that can be chosen.

    Attributes:
        folder: that the dialog is in.
        entries: what it holds: folders first, each in the order of their numbers and letters.
        message: a sentence where something cannot be had; "" else.
    """

    def __init__(self, start: Path, wanted: str, endings: Sequence[str] = ()) -> None:
        assert wanted in ("folder", "take", "file")
        self.wanted, self.endings = wanted, tuple(endings)
        self.entries: list[Entry] = []
        self.message = ""
        start = start.expanduser().absolute()
        self.folder = next((path for path in (start, *start.parents) if path.is_dir()), Path("/"))
        self._read()

    def enter(self, path: Path) -> bool:
        """Go into a folder; False, with `message`, where it cannot be read."""
        before = self.folder
        self.folder = path
        if self._read():
            return True
        message, self.folder = self.message, before
        self._read()
        self.message = message
        return False

    def up(self) -> None:
        """To the folder that holds this one."""
        self.enter(self.folder.parent)

    def choose(self, path: Path, twice: bool = False) -> Path | None:
        """What is to be opened when this path is chosen; None where choosing it leads on into the folder, or to a
        message.

        Args:
            path: an entry's, `folder` itself, or typed.
            twice: chosen by a double click, which goes into folders that could as well be meant.
        """
        path = path.expanduser()
        path = path if path.is_absolute() else self.folder / path
        if not path.exists():
            self.message = f"{path}: there is no such {'file' if self.wanted == 'file' else 'folder'}; choose another."
            return None
        if not path.is_dir():
            if self.wanted == "file" or path.name in ("take.json", "manifest.json"):
                return path
            self.message = f"{path} is a file; choose a folder."
            return None
        kind = kind_of(path)
        if self.wanted == "folder" and not twice:
            return path
        if self.wanted == "take" and kind != "folder":
            return path
        inside = path == self.folder
        if self.enter(path) and inside:
            self.message = {
                "take": f"{path} is neither a take nor a stream; choose one of the folders in it, or go up.",
                "file": "Choose a file of the list, or type its name.",
            }.get(self.wanted, "")
        return None

    def _read(self) -> bool:
        self.message = ""
        try:
            with os.scandir(self.folder) as found:
                names = [(entry.name, entry.is_dir()) for entry in found if not entry.name.startswith(".")]
        except OSError as error:
            self.message = f"{self.folder} cannot be read ({error.strerror}); choose another folder."
            return False
        folders = sorted((name for name, is_folder in names if is_folder), key=_natural)
        files = sorted((name for name, is_folder in names if not is_folder and self._fits(name)), key=_natural)
        shown = folders[:MOST_ENTRIES]
        self.entries = [Entry(self.folder / name, kind_of(self.folder / name)) for name in shown]
        self.entries += [Entry(self.folder / name, "file") for name in files[: MOST_ENTRIES - len(shown)]]
        if len(folders) + len(files) > MOST_ENTRIES:
            self.message = f"Only the first {MOST_ENTRIES} entries are listed; type the path of another one."
        return True

    def _fits(self, name: str) -> bool:
        return self.wanted == "file" and (not self.endings or name.lower().endswith(self.endings))


def kind_of(folder: Path) -> str:
    """ "take", "stream" or "folder"."""
    if (folder / "take.json").is_file():
        return "take"
    return "stream" if (folder / "manifest.json").is_file() else "folder"


def _natural(name: str) -> list[tuple[bool, int, str]]:
    """cam2 before cam10."""
    parts = re.split(r"(\d+)", name.lower())
    return [(part.isdecimal(), int(part) if part.isdecimal() else 0, part) for part in parts]
