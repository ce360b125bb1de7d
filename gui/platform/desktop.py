"""What the desktop does for the window: showing a folder, and a page in the browser."""

import shutil
import subprocess
from pathlib import Path

from studio.errors import StudioError


def show_folder(path: Path) -> None:
    """Show the folder of a file, or a folder itself, in the file manager. Raises StudioError: that is not possible."""
    _begin(path if path.is_dir() else path.parent, "folder")


class PageOpener:
    """Opens pages in the browser, without waiting for it."""

    def __init__(self) -> None:
        self._begun: dict[Path, subprocess.Popen[bytes]] = {}

    def open(self, page: Path) -> None:
        """Open an HTML file. Raises StudioError: that is not possible; `failure` tells what turns out later."""
        self._begun[page] = _begin(page, "file")

    def failure(self) -> str:
        """Why a page could not be opened, as soon as that is known, once; "" if there is nothing to tell."""
        for page, process in list(self._begun.items()):
            status = process.poll()
            if status is not None:
                del self._begun[page]
                if status:
                    return f"{page}: no browser opened it. Install one, or open the file on a machine that has one."
        return ""


def _begin(path: Path, kind: str) -> subprocess.Popen[bytes]:
    """Start the program for a file or folder."""
    if not path.exists():
        raise StudioError("gui.path_gone", f"no such {kind}", file=path, fix="It was moved or deleted.")
    program = shutil.which("xdg-open")
    if program is None:
        problem, fix = "cannot be opened, as xdg-open is not installed", "Install the package xdg-utils."
        raise StudioError("gui.no_xdg_open", problem, file=path, fix=fix)
    try:
        return subprocess.Popen(
            [program, str(path)], stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
            start_new_session=True,
        )  # fmt: skip
    except OSError as error:
        raise StudioError("gui.not_opened", f"cannot be opened: {error}", file=path) from None
