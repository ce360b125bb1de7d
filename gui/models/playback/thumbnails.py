"""Thumbnails: small images of frames from given views, drawn one by one on a thread with sources of its own."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from v3studio.gui.drawing.compare import What
from v3studio.gui.models.camera_path import reframed
from v3studio.gui.models.loop import Signal
from v3studio.gui.models.playback.sources import FrameSource, open_path
from v3studio.gui.models.playback.viewpoint import BACKGROUNDS
from v3studio.gui.models.scene.compose import draw
from v3studio.gui.models.worker import Done, LatestWorker
from v3studio.studio.cameras import Camera
from v3studio.studio.memory_cache import MemoryCache

KEPT = 200  # pictures that are kept


@dataclass(frozen=True)
class _Request:
    place: Path | str
    contents: object
    camera: Camera
    frame: int
    size: tuple[int, int]

    @property
    def key(self) -> tuple[object, ...]:
        """The subject of the image, apart from `contents`."""
        camera = self.camera
        view = (camera.K.tobytes(), camera.world_to_camera.tobytes(), camera.width, camera.height)
        return (str(self.place), *view, self.frame, self.size)


class Thumbnails:
    """Small images of frames, drawn on a thread. Trained frames are used where there are any: each is read on its own.

    Signals:
        changed: another image is drawn.
    """

    def __init__(self) -> None:
        self._worker: LatestWorker[_Request, np.ndarray] = LatestWorker(
            self._draw, "v3studio thumbnails", self._drawn, ended=self._close_source
        )
        self.changed: Signal[[]] = Signal()
        self._pictures: MemoryCache[tuple[object, ...], tuple[object, np.ndarray | None]] = MemoryCache(KEPT)
        self._source: FrameSource | None = None
        self._source_of: object = None
        self._asked = False

    def get(
        self, place: Path | str, contents: object, camera: Camera, frame: int, size: tuple[int, int], ask: bool = True
    ) -> np.ndarray | None:
        """An image if it is there; else it is asked for (`ask`), unless another one is being drawn. Until the new one
        is there, the last one with other `contents`, which change when its frames do, is returned."""
        request = _Request(place, contents, camera, frame, size)
        held = self._pictures.get(request.key)
        if ask and not self._asked and (held is None or held[0] != contents):
            self._asked = True
            self._worker.ask(request)
        return held[1] if held is not None else None

    def _drawn(self, done: Done[_Request, np.ndarray]) -> None:
        """Keep a new image. One that failed is not asked for again."""
        self._asked = False
        self._pictures.put(done.request.key, (done.request.contents, done.result))
        self.changed.emit()

    def _draw(self, request: _Request) -> np.ndarray:
        if self._source_of != (request.place, request.contents):
            self._close_source()
            opened = open_path(request.place)
            source = opened.sources.get(What.TRAINED) or opened.default
            opened.close(kept=source)
            self._source, self._source_of = source, (request.place, request.contents)
        if self._source is None:
            raise LookupError("nothing to draw")
        frame = min(request.frame, self._source.frame_count - 1)
        return draw(self._source.gaussians(frame), reframed(request.camera, *request.size), BACKGROUNDS["dark"])

    def _close_source(self) -> None:
        if self._source is not None:
            self._source.close()
        self._source = self._source_of = None
