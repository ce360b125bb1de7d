"""Opening takes and streams, on any thread."""

import contextlib
from pathlib import Path

from gui.models.playback.sources import FrameSource, Opened, open_path, reach_of
from gui.models.playback.stream_source import LeftOut
from studio.errors import StudioError
from studio.gaussians import Gaussians


def first_whole(source: FrameSource) -> Gaussians:
    """The first playable keyframe."""
    *others, last = source.group_starts
    for start in others:
        with contextlib.suppress(LeftOut):
            return source.gaussians(start)
    return source.gaussians(last)


def load(path: str | Path) -> tuple[Opened, Gaussians | None] | str:
    """Open a take, a stream or a URL, and its first frame; or return the error message. Thread-safe."""
    try:
        opened = open_path(path)
        try:
            first = first_whole(opened.default) if opened.default is not None else None
            opened.reach = reach_of(opened)
        except StudioError as error:
            if opened.take is None:
                for source in opened.sources.values():
                    source.close()
                raise
            first, opened.message = None, str(error)  # the rest of the take can still be shown
    except StudioError as error:
        return str(error)
    except Exception as error:  # a bug must not close the window
        return f"{path}: cannot be opened: {type(error).__name__}: {error}"
    return opened, first
