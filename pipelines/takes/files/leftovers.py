"""Deletes what killed runs left in a take."""

import contextlib
import os
from pathlib import Path

from v3studio.studio.atomic_files import PARTIAL, is_being_written, remove


def sweep_partial(folder: Path) -> int:
    """Delete partially written files and folders that killed runs left under `folder`, and results that are empty, as
    a power cut leaves files whose names were on the disk before their bytes; returns how many.

    Those of processes that still run stay: marks are written, and exports made, while a run continues. So do those of
    other machines until nothing was written to them for an hour: groups may be worked on there.
    """
    paths = _leftovers(folder)
    for path in paths:
        remove(path)
    return len(paths)


_NEVER_EMPTY = (".json", ".safetensors", ".checkpoint", ".ply")
_MADE_BY_PEOPLE = ("camera_path.json", "edits.json", "marks.json")


def _leftovers(folder: Path) -> list[Path]:
    """The paths that `sweep_partial` deletes. Empty files are those of kinds that this program never writes empty, but
    not what a person made, and no temporary ones: those that are being written begin empty."""
    paths = []
    for root, folders, names in os.walk(folder):
        for name in [name for name in (*folders, *names) if PARTIAL in name]:
            path = Path(root, name)
            set_aside = f".old{PARTIAL}" in name  # `restore_old` puts it back
            if name.startswith(".") and not set_aside and not is_being_written(path):
                paths.append(path)
        folders[:] = [name for name in folders if PARTIAL not in name]
        for name in names:
            if name.endswith(_NEVER_EMPTY) and PARTIAL not in name and name not in _MADE_BY_PEOPLE:
                with contextlib.suppress(FileNotFoundError):
                    if os.lstat(file := os.path.join(root, name)).st_size == 0:
                        paths.append(Path(file))
    return paths
