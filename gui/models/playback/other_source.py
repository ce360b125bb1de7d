"""OtherSource: another bake or another take, shown at the times of the open take or stream, to compare the two."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from v3studio.gui.drawing.compare import What
from v3studio.gui.models.evaluation import Evaluation
from v3studio.gui.models.playback.sources import FrameSource, open_path
from v3studio.gui.models.playback.stream_source import StreamSource
from v3studio.pipelines.takes.results.evaluation import measured_earlier_bake
from v3studio.studio.errors import StudioError
from v3studio.studio.gaussians import Gaussians

OTHERS = (What.OTHER, "other 2", "other 3")
"""Names of what the open take or stream is compared with, the last one first: side by side shows all of them."""

MOST_BESIDE = 4  # images side by side


def shown_beside(names: Sequence[str], camera: str) -> tuple[str, ...]:
    """The images side by side, of the sources that there are. `camera`: the capture camera; "" for the free view."""
    others = tuple(name for name in OTHERS if name in names)
    own = tuple(name for name in (What.TRAINED, What.DECODED) if name in names)
    if others and (not camera or len(others) > 1):
        own = own[-1:]
    shown = (*((What.FOOTAGE,) if camera else ()), *own, *others)
    return shown[-MOST_BESIDE:]


class OtherSource:
    """Frames of another source, by time: each frame of the open take or stream shows the other's frame of the same
    second, and after the other's end its last one. `place`: the folder of the take or stream."""

    name: str = What.OTHER

    def __init__(self, source: FrameSource, label: str, evaluation: Evaluation, place: Path) -> None:
        self._source, self.label, self._evaluation, self.place = source, label, evaluation, place
        self.frame_count, self.fps = source.frame_count, source.fps
        self.group_starts: Sequence[int] = source.group_starts

    def span(self, base: FrameSource) -> None:
        """Take the frames of the open take or stream."""
        self.frame_count, self.fps, self.group_starts = base.frame_count, base.fps, base.group_starts

    def frame_of(self, frame: int) -> int:
        """The other's frame at a frame of the open take or stream."""
        return min(round(frame * self._source.fps / self.fps), self._source.frame_count - 1)

    @property
    def has_set(self) -> bool:
        """Tell whether the other has splats behind the performer."""
        return self._source.has_set

    def behind(self) -> Gaussians | None:
        """The splats behind the performer of the other."""
        return self._source.behind()

    def gaussians(self, frame: int) -> Gaussians:
        return self._source.gaussians(self.frame_of(frame))

    @property
    def evaluation(self) -> Evaluation:
        """Its figures, by the frames of the open take or stream."""
        frames = ((frame, self._evaluation.frames.get(self.frame_of(frame))) for frame in range(self.frame_count))
        known = {frame: quality for frame, quality in frames if quality is not None}
        return replace(self._evaluation, frames=known, of=self.label)

    @property
    def exported(self) -> tuple[Path, str]:
        """The folder to export, that of a take if it is in one, and which of its splats."""
        take = next((folder for folder in (self.place, self.place.parent) if (folder / "take.json").is_file()), None)
        return (self.place, "") if take is None else (take, self._source.name)

    def series(self, name: str, camera: str = "") -> list[float | None]:
        """A metric, or "bytes", for every frame of the open take or stream; None where it was not measured."""
        count = self._source.frame_count
        series = self._evaluation.series(name, count, camera)
        if name == "bytes" and not self._evaluation.frames and isinstance(self._source, StreamSource):
            groups = self._source.groups
            series = [None] * self._source.first
            series += [group.bytes / group.frame_count for group in groups for _ in range(group.frame_count)]
        return [series[self.frame_of(frame)] for frame in range(self.frame_count)]

    def close(self) -> None:
        self._source.close()


def open_other(place: Path, label: str = "", evaluation: Path | None = None, in_take: bool = True) -> OtherSource:
    """Open the folder of a stream or of a take to compare with; StudioError if it is neither, it is damaged, or nothing
    in it can be shown (`gui.nothing_to_compare`).

    `evaluation`: its evaluation.json; None for that of a take, unless it is of an earlier bake. `in_take`: whether a
    stream has the frames and the world of the take that it was baked from, as the open one has if that is a take.
    """
    opened = open_path(place, in_take)
    if opened.default is None:
        fix = "Choose another one, or run its stages."
        raise StudioError("gui.nothing_to_compare", "nothing is trained or baked in this take", file=place, fix=fix)
    source = opened.default
    opened.close(kept=source)
    if isinstance(source, StreamSource):
        source.fades = False  # both sides of a comparison show everything
    if evaluation is None and opened.take is not None and not measured_earlier_bake(opened.take):
        evaluation = opened.take.evaluation
    measured = Evaluation.read(evaluation) if evaluation is not None else Evaluation()
    return OtherSource(source, label or opened.title, measured, place)
