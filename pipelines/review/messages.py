"""The JSON messages between server and review page (docs/WEB.md); `web/src/review/api.ts` has the same."""

from pydantic import BaseModel, ConfigDict, Field

from v3studio.pipelines.takes.authored.marks import Mark, MarkView

VERSION = 1


class _Message(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)


class MetricCurves(_Message):
    """A metric (`studio.comparison.metrics`) by frame of the stream; null where a frame was not measured."""

    title: str
    unit: str
    digits: int
    trained: tuple[float | None, ...]
    decoded: tuple[float | None, ...]
    by_camera: dict[str, tuple[float | None, ...]]  # of the decoded stream by camera
    words: tuple[float, float] | None  # `Metric.words`


class QualityCurves(_Message):
    """Figures by frame of the stream; null where a frame was not measured."""

    metrics: tuple[MetricCurves, ...]  # those that were measured; the first one is plotted
    bytes: tuple[float | None, ...]  # size of the group's videos divided by its number of frames
    held_out: bool  # False: training cameras were measured


class ReviewCamera(_Message):
    """A camera whose footage can be compared."""

    name: str
    width: int  # of its images, pixels; so are K and height
    height: int
    K: tuple[tuple[float, ...], ...]  # (3, 3), origin at the corner of the image
    world_to_camera: tuple[tuple[float, ...], ...]  # (4, 4)
    undistorted: bool  # whether lens distortion has been removed from its images


class ReviewData(_Message):
    """`.review/data.json`."""

    version: int = VERSION
    frame_count: int
    quality: QualityCurves | None  # None: not measured yet
    cameras: tuple[ReviewCamera, ...]  # the held-out ones, or the measured ones where none is held out
    background: tuple[float, float, float]  # RGB, 0 to 1: what the performer of the images stands in front of
    problems: tuple[str, ...]  # what is missing and why, a sentence each


class MarkContent(_Message):
    """A mark without its frame."""

    note: str = Field(max_length=20_000)
    author: str = Field(max_length=2_000)
    view: MarkView | None = None  # None: not known


class MarkChange(_Message):
    """Body of a POST to `.review/marks`."""

    frame: int = Field(ge=0)
    mark: MarkContent | None  # None removes the mark
    replaces: MarkContent | None  # the frame's mark as the sender has seen it; None for none


class MarkList(_Message):
    """Answer to GET and POST of `.review/marks`."""

    marks: tuple[Mark, ...] | None  # in the order of their frames; None: they cannot be read
    problem: str | None = None  # why a change was refused, a sentence
