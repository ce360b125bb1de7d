"""Services of the desktop: showing a folder in the file manager, and a page in the browser."""

import shutil
import subprocess
from pathlib import Path

from v3studio.studio.errors import StudioError


class Opener:
    """Opens folders and HTML files, without waiting for the program that shows them."""

    def __init__(self) -> None:
        self._begun: dict[Path, subprocess.Popen[bytes]] = {}

    def open(self, path: Path) -> None:
        """Open a folder or a file. Raises StudioError: that is not possible; `failure` tells what turns out later."""
        if not path.exists():
            raise StudioError("gui.path_gone", "no such file or folder", file=path, fix="It was moved or deleted.")
        program = shutil.which("xdg-open")
        if program is None:
            problem, fix = "cannot be opened, as xdg-open is not installed", "Install the package xdg-utils."
            raise StudioError("gui.no_xdg_open", problem, file=path, fix=fix)
        try:
            self._begun[path] = subprocess.Popen(
                [program, str(path)], stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                start_new_session=True,
            )  # fmt: skip
        except OSError as error:
            raise StudioError("gui.not_opened", f"cannot be opened: {error}", file=path) from None

    def failure(self) -> str:
        """Return why something could not be opened, as soon as that is known, once; "" if there is nothing to tell."""
        for path, process in list(self._begun.items()):
            status = process.poll()
            if status is not None:
                del self._begun[path]
                if status:
                    program = "file manager" if path.is_dir() else "browser"
                    return f"{path}: no {program} opened it. Install one, or open it on a machine that has one."
        return ""
