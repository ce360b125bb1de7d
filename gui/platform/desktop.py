"""What the desktop does for the window: showing a folder, and a page in the browser."""

import shutil
import subprocess
from pathlib import Path


def show_folder(path: Path) -> str:
    """Show the folder of a file, or a folder itself, in the file manager. Returns "", or why that is not possible."""
    folder = path if path.is_dir() else path.parent
    if not folder.is_dir():
        return f"{folder}: no such folder. It was moved or deleted."
    begun = _begin(folder)
    return begun if isinstance(begun, str) else ""


class PageOpener:
    """Opens pages in the browser, without waiting for it."""

    def __init__(self) -> None:
        self._begun: dict[Path, subprocess.Popen[bytes]] = {}

    def open(self, page: Path) -> str:
        """Open an HTML file. Returns "", or why that is not possible; `failure` tells what turns out later."""
        if not page.is_file():
            return f"{page}: no such file. It was moved or deleted."
        begun = _begin(page)
        if isinstance(begun, str):
            return begun
        self._begun[page] = begun
        return ""

    def failure(self) -> str:
        """Why a page could not be opened, as soon as that is known, once; "" if there is nothing to tell."""
        for page, process in list(self._begun.items()):
            status = process.poll()
            if status is not None:
                del self._begun[page]
                if status:
                    return f"{page}: no browser opened it. Install one, or open the file on a machine that has one."
        return ""


def _begin(path: Path) -> subprocess.Popen[bytes] | str:
    """Start the program for a file or folder; without it, why that is not possible."""
    program = shutil.which("xdg-open")
    if program is None:
        return f"{path}: cannot be opened, as xdg-open is not installed. Install the package xdg-utils."
    try:
        return subprocess.Popen(
            [program, str(path)], stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
            start_new_session=True,
        )  # fmt: skip
    except OSError as error:
        return f"{path}: cannot be opened: {error}"
