"""What a browser needs to review a take: figures, pictures of the footage, marks."""

from __future__ import annotations

import sys
import threading
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from pipelines.review.messages import (
    MarkChange,
    QualityCurves,
    ReviewCamera,
    ReviewData,
)
from pipelines.stages.footage import TakeFootage, performer_over
from pipelines.takes.evaluation import Evaluation, read_evaluation
from pipelines.takes.marks import Mark, change_mark, read_marks
from pipelines.takes.records import read_record, result_of
from pipelines.takes.take import Take
from studio.errors import StudioError

if TYPE_CHECKING:
    from studio.capture import Footage

MAX_WIDTH = 1920
"""Largest width of a picture in pixels; larger ones are scaled down."""

_QUALITY = 90  # of JPEG


class TakeReview:
    """Thread safe. The footage is opened when it is first needed.

    Args:
        take: with a stream.

    Attributes:
        take: the take.
        frame_count: frames of its stream.

    Raises:
        StudioError: the stream cannot be opened.
    """

    def __init__(self, take: Take) -> None:
        self.take = take
        self.frame_count = self._count()
        self._opening = threading.Lock()

    def data(self) -> ReviewData:
        """Figures as they are in the take now, and the cameras to compare with.

        Missing results are no error but a sentence in `problems`, without paths of this machine.
        """
        self.frame_count = self._count()  # of a live stream, it grows
        problems = []
        evaluation: Evaluation | None = None
        try:
            evaluation = read_evaluation(self.take.evaluation)
        except StudioError as error:
            missing = error.code == "take.file_not_found"
            problems.append("The take has not been measured." if missing else "evaluation.json cannot be read.")
        else:
            if self._measured_another_stream():
                problems.append(
                    "The stream has been baked again since it was measured; the figures are those of the earlier one."
                )
        footage = self._opened
        if footage is None:
            problems.append("The footage cannot be opened on the server, so there is nothing to compare with.")
        return ReviewData(
            frame_count=self.frame_count,
            quality=None if evaluation is None else self._curves(evaluation),
            cameras=() if footage is None else tuple(_camera(footage, name) for name in _compared(footage)),
            background=self._background,
            problems=tuple(problems),
        )

    def picture(self, camera: str, frame: int) -> bytes:
        """The performer as a camera filmed them, over the background, as in the evaluation and the window: JPEG.

        The whole image of the camera without lens distortion, scaled to the size that `ReviewData.cameras` has.

        Args:
            camera: of `ReviewData.cameras`.
            frame: counted from 0.

        Raises:
            StudioError: no such camera (`review.no_camera`) or frame (`review.no_frame`), or the footage cannot be
                read.
        """
        import cv2

        from pipelines.reports.pictures import encode

        footage = self._opened
        if footage is None or camera not in _compared(footage):
            raise StudioError("review.no_camera", "no such camera to compare with", value=camera)
        if not 0 <= frame < min(self.frame_count, len(footage.frames)):
            raise StudioError("review.no_frame", "the footage has no such frame", value=frame)
        image = performer_over(footage, camera, footage.frames[frame], self._background)
        size = _size(footage, camera)
        if size != (image.shape[1], image.shape[0]):
            image = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA))
        return encode(image, ".jpg", _QUALITY)

    def marks(self) -> dict[int, Mark]:
        """Marks by frame; raises StudioError as `read_marks`."""
        return read_marks(self.take.marks)

    def change(self, change: MarkChange) -> dict[int, Mark]:
        """Add, change or remove a mark; returns all marks.

        Raises:
            StudioError: no such frame (`review.no_frame`), or as `change_mark`.
        """
        if change.frame >= self.frame_count:
            raise StudioError("review.no_frame", "the take has no such frame", value=change.frame)
        new, old = (
            None if one is None else Mark(frame=change.frame, note=one.note, author=one.author, view=one.view)
            for one in (change.mark, change.replaces)
        )
        return change_mark(self.take.marks, change.frame, new, old)

    def _measured_another_stream(self) -> bool:
        record = read_record(self.take, "evaluate")
        return record is not None and record.params.get("result of bake") != result_of(self.take, "bake")

    def _count(self) -> int:
        from studio.stream import StreamReader

        with StreamReader.open(self.take.stream) as reader:
            return reader.frame_count

    @cached_property
    def _settings(self) -> TakeFootage:
        from pipelines.config import load_config

        return TakeFootage(self.take, load_config(self.take.config))

    @property
    def _background(self) -> tuple[float, float, float]:
        try:
            red, green, blue = self._settings.config.capture.background
        except StudioError:
            return (0.0, 0.0, 0.0)
        return (red, green, blue)

    @property
    def _opened(self) -> Footage | None:
        """The footage with cameras; None, and a warning on this machine, if it cannot be opened."""
        with self._opening:
            return self._footage

    @cached_property
    def _footage(self) -> Footage | None:
        try:
            return self._settings.calibrated
        except StudioError as error:
            print(f"warning: {error} Review goes on without the footage.", file=sys.stderr, flush=True)
            return None

    def _curves(self, evaluation: Evaluation) -> QualityCurves:
        rows = {row.index: row for row in evaluation.frames}

        def curve(value: object) -> tuple[float | None, ...]:
            assert callable(value)
            return tuple(value(rows[index]) if index in rows else None for index in range(self.frame_count))

        def of_camera(name: str) -> tuple[float | None, ...]:
            return curve(lambda row: row.cameras[name].psnr_decoded if name in row.cameras else None)

        return QualityCurves(
            psnr_trained=curve(lambda row: row.psnr_trained),
            psnr_decoded=curve(lambda row: row.psnr_decoded),
            bytes=curve(lambda row: row.bytes),
            by_camera={name: of_camera(name) for name in evaluation.protocol.cameras},
            held_out=evaluation.protocol.held_out,
        )


def _compared(footage: Footage) -> tuple[str, ...]:
    """The held-out cameras, or all where none is held out."""
    return footage.held_out_cameras or footage.train_cameras


def _size(footage: Footage, camera: str) -> tuple[int, int]:
    """(width, height) of a camera's pictures."""
    own = footage.rig[camera]
    scale = min(MAX_WIDTH / own.width, 1.0)
    return max(round(own.width * scale), 1), max(round(own.height * scale), 1)


def _camera(footage: Footage, name: str) -> ReviewCamera:
    camera = footage.rig[name].resized(*_size(footage, name))
    return ReviewCamera(
        name=name,
        width=camera.width,
        height=camera.height,
        K=tuple(tuple(map(float, row)) for row in camera.K),
        world_to_camera=tuple(tuple(map(float, row)) for row in camera.world_to_camera),
        undistorted=footage.has_lens_distortion(name),
    )
