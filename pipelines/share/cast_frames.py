"""The splats of a cast, frame by frame: its streams and static splats where the document puts them."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from pipelines.share.cast import Item, beside, read_cast
from pipelines.takes.videos import FALLBACK_FPS, stream_place
from studio.cameras import Camera
from studio.edits.moving import moved
from studio.errors import StudioError
from studio.formats import read_splats
from studio.gaussians import Gaussians
from studio.similarity import Similarity, rotation_between

if TYPE_CHECKING:
    from studio.stream import StreamReader

LONGEST = 3600.0
"""Seconds after which a cast starts over at the latest."""

_UP = np.array([0.0, 1.0, 0.0])
_SIZE = (1280, 720)


class CastFrames:
    """See the module. Frames come at the highest rate of the streams, until the last of them has ended; those that
    have ended before start over, as on the page. All splats are rendered with the dilation of the first stream, as
    there.

    Attributes:
        models: GLB files, and where they are.
    """

    name = "decoded"

    def __init__(self, source: Path) -> None:
        cast = read_cast(source)
        view = cast.camera
        self.camera = Camera.look_at(
            view.position, view.target, _UP, width=_SIZE[0], height=_SIZE[1], field_of_view=view.fov
        )
        self.group_starts: Sequence[int] = (0,)
        self.models: list[tuple[Path, Similarity]] = []
        self._still: list[Gaussians] = []
        self._streams: list[tuple[StreamReader, Similarity, float]] = []
        with ExitStack() as stack:
            for item in cast.items:
                self._add(item, source, stack)
            self._open = stack.pop_all()
        if not self._streams and not self._still:
            fix = "Add a stream or static splats."
            raise StudioError("share.no_splats", "the window shows casts with splats only", file=source, fix=fix)
        self.fps = max((float(reader.fps) for reader, _, _ in self._streams), default=FALLBACK_FPS)
        ends = [start + reader.frame_count / reader.fps for reader, _, start in self._streams]
        self.frame_count = max(1, round(min(max(ends, default=0.0), LONGEST) * self.fps))

    def gaussians(self, frame: int) -> Gaussians:
        """The splats of all in a frame. Raises StudioError if a stream is damaged."""
        parts = []
        for reader, world, start in self._streams:
            seconds = max(frame / self.fps - start, 0.0)
            parts.append(moved(reader.gaussians(int(seconds * reader.fps + 1e-6) % reader.frame_count), world))
        parts += self._still
        degree = max(part.sh_degree for part in parts)
        dilation = parts[0].dilation
        return Gaussians.cat(*(replace(part.with_sh_degree(degree), dilation=dilation) for part in parts))

    def close(self) -> None:
        """Release files and memory."""
        self._open.close()

    def _add(self, item: Item, source: Path, stack: ExitStack) -> None:
        turn = Rotation.from_euler("XYZ", item.turn, degrees=True).as_matrix()
        place = Similarity(item.scale, turn, np.array(item.position))
        if item.stream is not None:
            from studio.stream import StreamReader

            reader = stack.enter_context(StreamReader.open(stream_place(beside(item.stream, source))))
            self._streams.append((reader, place.after(standing(reader)), item.start))
        elif item.splats is not None:
            self._still.append(moved(read_splats(beside(item.splats, source)), place))
        elif item.model is not None:
            path = Path(beside(item.model, source))
            if not path.is_file():
                fix = f"Correct the path in {source}."
                raise StudioError("share.bad_cast", "no such file", file=path, fix=fix)
            self.models.append((path, place))


def standing(reader: StreamReader) -> Similarity:
    """From the world of a stream to one with y up, whose ground is below its lowest point."""
    from studio.stream import StreamMetadata

    up = StreamMetadata.from_json(reader.manifest.metadata).up
    turn = np.eye(3) if up is None else rotation_between(np.array(up), _UP)  # as three.js's setFromUnitVectors
    box = reader.manifest.bounding_box
    lowest = np.minimum(turn[1] * box.min, turn[1] * box.max).sum()
    return Similarity(1.0, turn, -lowest * _UP)
