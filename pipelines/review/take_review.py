"""Everything that a browser needs to review a take: figures, images of the footage, marks."""

import threading
from contextlib import suppress
from functools import cached_property

import numpy as np

from v3studio.pipelines.config import load_config
from v3studio.pipelines.reports.terminal import say
from v3studio.pipelines.review.messages import MarkChange, MetricCurves, QualityCurves, ReviewCamera, ReviewData
from v3studio.pipelines.stages.compared_view import compared_cameras, performer_over
from v3studio.pipelines.stages.inputs import Inputs
from v3studio.pipelines.takes.authored.marks import Mark, MarkView, change_mark, read_marks
from v3studio.pipelines.takes.frames.frame_numbers import trained_numbers
from v3studio.pipelines.takes.results.evaluation import Evaluation, measured_earlier_bake, read_evaluation
from v3studio.pipelines.takes.results.videos import capture_place
from v3studio.pipelines.takes.take import Take
from v3studio.studio.errors import StudioError
from v3studio.studio.footage import Footage
from v3studio.studio.similarity import Similarity
from v3studio.studio.stream import CapturePlace

MAX_WIDTH = 1920  # largest width of an image in pixels; larger ones are scaled down

_QUALITY = 90  # of JPEG


class TakeReview:
    """A take's review, thread-safe; opens the footage when first needed. `place`: where the stream lies in the take."""

    def __init__(self, take: Take) -> None:
        self.take = take
        self.frame_count, self.place = self._stream()
        self._opening = threading.Lock()
        self._warned = ""

    def data(self) -> ReviewData:
        """Figures as they are in the take now, and the cameras to compare with.

        Missing results are no error but a sentence in `problems`, without paths of this machine.
        """
        self.frame_count, self.place = self._stream()  # of a live stream, it grows
        problems = []
        evaluation: Evaluation | None = None
        try:
            evaluation = read_evaluation(self.take.evaluation)
        except StudioError as error:
            missing = error.code == "take.file_not_found"
            problems.append("The take has not been measured." if missing else "evaluation.json cannot be read.")
        else:
            if measured_earlier_bake(self.take):
                problems.append(
                    "The stream has been baked again since it was measured; the figures are those of the earlier one."
                )
        footage = self._opened
        if footage is None:
            problems.append("The footage cannot be opened on the server, so there is nothing to compare with.")
        return ReviewData(
            frame_count=self.frame_count,
            quality=None if evaluation is None else self._curves(evaluation),
            cameras=tuple(_camera(footage, name, self.place) for name in compared_cameras(footage)) if footage else (),
            background=self._background,
            problems=tuple(problems),
        )

    def picture(self, camera: str, frame: int) -> bytes:
        """The performer as a camera filmed them, over the background, as in the evaluation and the window: JPEG.

        The whole image of the camera without lens distortion, scaled to the size that `ReviewData.cameras` has.
        """
        import cv2

        from v3studio.pipelines.reports.images import encode

        footage = self._opened
        if footage is None or camera not in compared_cameras(footage):
            raise StudioError("review.no_camera", "no such camera to compare with", value=camera)
        first = self.place.first_frame
        if not 0 <= frame < min(self.frame_count, len(footage.frames) - first):
            raise StudioError("review.no_frame", "the footage has no such frame", value=frame)
        image = performer_over(footage, camera, footage.frames[first + frame], self._background)
        size = _size(footage, camera)
        if size != (image.shape[1], image.shape[0]):
            image = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA))
        return encode(image, ".jpg", _QUALITY)

    def marks(self) -> tuple[Mark, ...]:
        """Marks of the stream's frames, in their order; raises StudioError as `read_marks`."""
        return self._in_stream(read_marks(self.take.marks))

    def change(self, change: MarkChange) -> tuple[Mark, ...]:
        """Add, change or remove a mark; returns all marks as `marks` does."""
        if change.frame >= self.frame_count:
            raise StudioError("review.no_frame", "the take has no such frame", value=change.frame)
        frame = trained_numbers(self.take).number(self.place.first_frame + change.frame)
        back = self.place.world.inverse
        new, old = (
            None
            if content is None
            else Mark(frame=frame, note=content.note, author=content.author, view=_seen_from(content.view, back))
            for content in (change.mark, change.replaces)
        )
        return self._in_stream(change_mark(self.take.marks, frame, new, old))

    def _in_stream(self, marks: dict[int, Mark]) -> tuple[Mark, ...]:
        """Marks of a take, with frames and positions of its stream, without those of frames that it does not have."""
        first, world, numbers = self.place.first_frame, self.place.world, trained_numbers(self.take)
        indices = {numbers.index(frame): mark for frame, mark in sorted(marks.items())}
        return tuple(
            mark.model_copy(update={"frame": index - first, "view": _seen_from(mark.view, world)})
            for index, mark in indices.items()
            if index is not None and 0 <= index - first < self.frame_count
        )

    def _stream(self) -> tuple[int, CapturePlace]:
        from v3studio.studio.stream import StreamReader

        with StreamReader.open(self.take.stream) as reader:
            return reader.frame_count, capture_place(reader)

    @cached_property
    def _settings(self) -> Inputs:
        return Inputs(self.take, load_config(self.take.config))

    @property
    def _background(self) -> tuple[float, float, float]:
        with suppress(StudioError):
            return self._settings.config.evaluate.background
        return (0.0, 0.0, 0.0)

    @property
    def _opened(self) -> Footage | None:
        """The footage with cameras; None, and a warning on this machine, while it cannot be opened."""
        with self._opening:
            try:
                return self._settings.trained_footage
            except StudioError as error:
                if str(error) != self._warned:
                    self._warned = str(error)
                    say(f"warning: {error} The review continues without the footage.", error=True)
                return None

    def _curves(self, evaluation: Evaluation) -> QualityCurves:
        measured = {row.index - self.place.first_frame: row for row in evaluation.frames}
        rows = [measured.get(index) for index in range(self.frame_count)]

        def curve(measure: str, camera: str = "") -> tuple[float | None, ...]:
            measurements = [row.cameras.get(camera) if row is not None and camera else row for row in rows]
            return tuple(
                None if measurement is None else measurement.measures.get(measure) for measurement in measurements
            )

        return QualityCurves(
            metrics=tuple(
                MetricCurves(
                    title=metric.title,
                    unit=metric.unit,
                    digits=metric.digits,
                    words=metric.words,
                    trained=curve(f"{metric.name}_trained"),
                    decoded=curve(f"{metric.name}_decoded"),
                    by_camera={name: curve(f"{metric.name}_decoded", name) for name in evaluation.protocol.cameras},
                )
                for metric in evaluation.metrics
            ),
            bytes=tuple(None if row is None else row.bytes for row in rows),
            held_out=evaluation.protocol.held_out,
        )


def _size(footage: Footage, camera: str) -> tuple[int, int]:
    """(width, height) of a camera's images."""
    own = footage.rig[camera]
    scale = min(MAX_WIDTH / own.width, 1.0)
    return max(round(own.width * scale), 1), max(round(own.height * scale), 1)


def _seen_from(view: MarkView | None, world: Similarity) -> MarkView | None:
    """A view in another world."""
    if view is None or world.is_identity:
        return view
    points = {name: point for name in ("eye", "target", "place") if (point := getattr(view, name)) is not None}
    moved = world.points(np.array(list(points.values()))).tolist()
    return view.model_copy(update={name: tuple(point) for name, point in zip(points, moved, strict=True)})


def _camera(footage: Footage, name: str, place: CapturePlace) -> ReviewCamera:
    camera = place.camera(footage.rig[name].resized(*_size(footage, name)))
    return ReviewCamera(
        name=name,
        width=camera.width,
        height=camera.height,
        K=tuple(tuple(map(float, row)) for row in camera.K),
        world_to_camera=tuple(tuple(map(float, row)) for row in camera.world_to_camera),
        undistorted=footage.has_lens_distortion(name),
    )
