"""Imports splat videos of other programs as `SplatVideo`, for baking, playback and comparison."""

from __future__ import annotations

from pathlib import Path

from studio.imports.sequence import DEFAULT_FPS, check_one_format, formats_in, open_sequence
from studio.imports.videogs import is_videogs, open_videogs
from studio.progress import ProgressFn, no_progress
from studio.splat_video import SplatVideo


def open_import(place: Path, fps: float = DEFAULT_FPS, progress: ProgressFn = no_progress) -> SplatVideo:
    """Open the VideoGS layout, a folder of splat files of one format (see `studio.splat_files`), or a single such file.

    Args:
        place: folder or file.
        fps: frame rate of playback, which none of these formats stores.
        progress: called with scanned and total files.

    Raises:
        StudioError: the input has none of these formats or more than one of them, or its files are damaged.
    """
    if is_videogs(place):
        check_one_format(place, {"VideoGS": [place / "group_info.json"], **formats_in(place)})
        return open_videogs(place, fps)
    return open_sequence(place, fps, progress)


__all__ = ["DEFAULT_FPS", "open_import", "open_sequence", "open_videogs"]
