"""Opening what is to be shown, on whatever thread has time for it."""

from __future__ import annotations

import contextlib
from pathlib import Path

from gui.presenters.playback.sources import FrameSource, Opened, open_path
from gui.presenters.playback.stream_source import LeftOut
from studio.errors import StudioError
from studio.gaussians import Gaussians


def _first_whole(source: FrameSource) -> Gaussians:
    """The first keyframe that can be had."""
    *others, last = source.group_starts
    for start in others:
        with contextlib.suppress(LeftOut):
            return source.gaussians(start)
    return source.gaussians(last)


def load(path: str | Path) -> tuple[Opened, Gaussians | None] | str:
    """Open a take, a stream or an address and its first frame; or a sentence on what is wrong. Safe on any thread."""
    try:
        opened = open_path(path)
        try:
            first = _first_whole(opened.default) if opened.default is not None else None
        except StudioError as error:
            if opened.take is None:
                for source in opened.sources.values():
                    source.close()
                raise
            first, opened.message = None, str(error)  # the rest of the take can still be looked at
    except StudioError as error:
        return str(error)
    except Exception as error:  # a defect of ours: it must not take the window with it
        return f"{path} could not be opened: {type(error).__name__}: {error}"
    return opened, first
