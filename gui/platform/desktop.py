"""What the desktop does for the window: showing a folder."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path


def show_folder(path: Path) -> str:
    """Show the folder of a file, or a folder itself, in the file manager.

    Returns:
        "", or why that is not possible.
    """
    folder = path if path.is_dir() else path.parent
    if not folder.is_dir():
        return f"{folder}: no such folder. It was moved or deleted."
    program = shutil.which("xdg-open")
    if program is None:
        return f"{folder}: cannot be shown, as xdg-open is not installed. Install the package xdg-utils."
    try:
        subprocess.Popen(
            [program, str(folder)], stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
            start_new_session=True,
        )  # fmt: skip
    except OSError as error:
        return f"{folder}: cannot be shown: {error}"
    return ""
