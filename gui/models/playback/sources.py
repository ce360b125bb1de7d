"""The sources of the Gaussians of a frame: a baked stream, or a take's trained frames."""

import contextlib
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

import numpy as np

from v3studio.gui.drawing.compare import What
from v3studio.gui.models.playback.stream_source import CACHE_BYTES, StreamSource
from v3studio.gui.models.stage_rows import message_text
from v3studio.pipelines.config import load_config
from v3studio.pipelines.share.cast import is_cast
from v3studio.pipelines.share.cast_frames import CastFrames
from v3studio.pipelines.takes.authored.edits import read_edits
from v3studio.pipelines.takes.frames.edited import EditedGroup
from v3studio.pipelines.takes.frames.frame_files import read_frame
from v3studio.pipelines.takes.frames.frame_numbers import FrameNumbers, frames_so_far
from v3studio.pipelines.takes.frames.take_set import take_set
from v3studio.pipelines.takes.results.videos import FALLBACK_FPS
from v3studio.pipelines.takes.take import Take
from v3studio.studio.camera_files import read_rig
from v3studio.studio.cameras import Camera, Rig
from v3studio.studio.edits.edit_list import EditList, Trim
from v3studio.studio.errors import StudioError
from v3studio.studio.gaussians import Gaussians
from v3studio.studio.memory_cache import MemoryCache
from v3studio.studio.own_frame import in_own_frame
from v3studio.studio.playback import LeftOut
from v3studio.studio.playback.stream_frames import bytes_of
from v3studio.studio.stream import is_address

REACH_FRAMES = 6  # number of trained frames from which `TrainedSource.reach` is known


class FrameSource(Protocol):
    """Frames of Gaussians, counted from 0. `gaussians` is called on one thread at a time and may be slow."""

    name: str
    frame_count: int
    fps: float
    group_starts: Sequence[int]

    @property
    def has_set(self) -> bool:
        """Tell whether there are splats behind the performer."""
        ...

    def behind(self) -> Gaussians | None:
        """The splats behind the performer, in all frames; None if there are none. StudioError as `gaussians`."""
        ...

    def gaussians(self, frame: int) -> Gaussians:
        """The splats of a frame. Raises StudioError if the file is missing or damaged."""
        ...

    def close(self) -> None: ...


@dataclass
class Opened:
    """An open take or stream."""

    title: str
    path: Path | str  # the folder, or the URL
    sources: dict[str, FrameSource]  # "decoded", "trained", in order of preference. A new take has none
    rig: Rig | None = None
    view: Camera | None = None
    # (3,) world up direction; z if no camera is known
    up: np.ndarray = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    take: Take | None = None  # None for a bare stream
    message: str = ""  # errors about parts that could not be opened; "" if there are none
    trim: Trim | None = None  # the frames that the take's edits keep; None for all
    numbers: FrameNumbers = field(default_factory=FrameNumbers)  # of the trained frames, as people know them
    # (N, 3) points of the performer in frames spread over the take, world coordinates; none for a bare stream
    reach: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    cast: CastFrames | None = None  # None unless it is one

    @property
    def default(self) -> FrameSource | None:
        """The source to show first; None if there is none yet."""
        return next(iter(self.sources.values()), None)

    def close(self, kept: FrameSource | None = None) -> None:
        """Close all sources but `kept`."""
        for source in self.sources.values():
            if source is not kept:
                source.close()

    def group(self, frame: int, starts: Sequence[int] = ()) -> int:
        """The number of a frame's group in the take's folders, from the first frame of each group of the footage, else
        of the trained groups. Those of its stream may differ: a trim drops some, `first_group_size` divides one."""
        trained = self.sources.get(What.TRAINED)
        known = starts or (trained.group_starts if trained is not None else ())
        return max(bisect_right(known, frame) - 1, 0)


class TrainedSource:
    """A take's trained frames, without the splats that its edits remove from complete groups. StudioError:
    `take.not_trained`, a group's file is damaged, or the edits cannot be read (`take.edits_*`)."""

    name: str = What.TRAINED

    def __init__(self, take: Take, fps: float) -> None:
        self.fps = fps
        self._files, groups = frames_so_far(take)
        if not self._files:
            raise StudioError("take.not_trained", "no trained frames yet", file=take.root / "train", stage="train")
        self.group_starts: Sequence[int] = tuple(
            next((index for index in group.indices if index in self._files), group.first) for group in groups
        )
        self.frame_count = groups[-1].first + len(groups[-1].frames)
        self.numbers = FrameNumbers.of(groups)
        edits = read_edits(take.edits)
        self._groups = [
            EditedGroup(take, group, edits if self._files.keys() >= set(group.indices) else EditList())
            for group in groups
        ]
        self._cache: MemoryCache[int, Gaussians] = MemoryCache(CACHE_BYTES, bytes_of, least=1)
        self._take = take
        self._set: MemoryCache[int, Gaussians | None] = MemoryCache(1)

    @property
    def has_set(self) -> bool:
        return self._take.set_splats.is_file()

    def behind(self) -> Gaussians | None:
        return self._set.get_or_make(0, lambda _: take_set(self._take))

    def gaussians(self, frame: int) -> Gaussians:
        if frame not in self._files:
            raise StudioError("take.frame_not_trained", "not trained yet", frame=frame)
        return self._cache.get_or_make(frame, self._read)

    def _read(self, frame: int) -> Gaussians:
        return self._groups[bisect_right(self.group_starts, frame) - 1].cut(read_frame(self._files[frame]))

    def reach(self) -> np.ndarray:
        """(N, 3) world coordinates of the performer in frames spread over the take, without damaged ones."""
        points = [np.zeros((0, 3))]
        files = list(self._files.values())
        for at in sorted({round(x) for x in np.linspace(0, len(files) - 1, REACH_FRAMES)}):
            with contextlib.suppress(StudioError):
                points.append(thinned(read_frame(files[at])))
        return np.concatenate(points)

    def close(self) -> None:
        self._cache.clear()


def reach_of(opened: Opened) -> np.ndarray:
    """`Opened.reach`, from the trained frames. Reads files."""
    trained = opened.sources.get(What.TRAINED)
    return trained.reach() if isinstance(trained, TrainedSource) else np.zeros((0, 3))


def body_of(gaussians: Gaussians) -> np.ndarray:
    """(N, 3): means of all splats that are not almost transparent; of all if there are none."""
    visible = gaussians.means[gaussians.opacities > 0.1]
    return np.asarray((visible if len(visible) else gaussians.means).detach().cpu().numpy())


def thinned(gaussians: Gaussians) -> np.ndarray:
    """(M, 3) float64: every n-th point of `body_of`, so that about 4000 are left."""
    points = body_of(gaussians)
    return points[:: max(len(points) // 4000, 1)].astype(np.float64)


def first_whole(source: FrameSource) -> Gaussians:
    """The first playable keyframe."""
    *others, last = source.group_starts
    for start in others:
        with contextlib.suppress(LeftOut):
            return source.gaussians(start)
    return source.gaussians(last)


def load(path: str | Path) -> tuple[Opened, Gaussians | None]:
    """Open a take, a stream or a URL, and its first frame. Raises StudioError. Thread-safe."""
    opened = open_path(path)
    try:
        first = first_whole(opened.default) if opened.default is not None else None
        opened.reach = reach_of(opened)
    except StudioError as error:
        if opened.take is None:
            opened.close()
            raise
        first, opened.message = None, message_text(error)  # the rest of the take can still be shown
    return opened, first


def open_path(place: Path | str, in_take: bool = False) -> Opened:
    """Open a folder of a take or a stream, the URL of a stream, or the document of a cast. Raises StudioError."""
    if isinstance(place, str) and is_address(place):
        return _open_stream(place, place.rstrip("/").rsplit("/", 1)[-1] or place, in_take)
    path = Path(place).expanduser().absolute()
    if path.is_file() and path.name in ("manifest.json", "take.json"):
        path = path.parent
    if (path / "take.json").exists():
        return _open_take(path)
    if (path / "manifest.json").exists() or path.suffix.lower() == ".v3s":
        return _open_stream(path, path.name, in_take)
    if path.is_file() and is_cast(str(path)):
        cast = CastFrames(path)
        up = np.array([0.0, 1.0, 0.0])
        return Opened(path.name, path, {cast.name: cast}, view=cast.camera, up=up, cast=cast)
    if not path.exists():
        problem = "no such folder"
        raise StudioError("gui.no_such_folder", problem, file=path, fix="Choose the folder of a take or of a stream.")
    problem = "neither a take (no take.json) nor a stream (no manifest.json)"
    raise StudioError("gui.not_take_or_stream", problem, file=path, fix="Choose another folder.")


def _open_stream(place: Path | str, title: str, in_take: bool) -> Opened:
    stream = StreamSource(place, in_take)
    stream.fades = True  # a viewer sees what viewers elsewhere see; who works on a take sees everything
    opened = Opened(title, place, {stream.name: stream}, view=stream.suggested_camera)
    if opened.view is not None:
        opened.up = -opened.view.rotation[1]
    return opened


def _open_take(path: Path) -> Opened:
    take = Take.open(path)
    opened = Opened(path.name, path, {}, take=take)
    problems = []
    try:
        if take.rig.exists():
            opened.rig = in_own_frame(read_rig(take.rig))
            opened.up, opened.view = opened.rig.up, next(iter(opened.rig), None)
    except StudioError as error:
        problems.append(message_text(error))
    try:
        opened.trim = read_edits(take.edits).trim
    except StudioError as error:
        problems.append(message_text(error))
    if take.has_stream:
        try:
            decoded = StreamSource(take.stream, in_take=True)
            opened.sources[decoded.name] = decoded
        except StudioError as error:  # trained frames can still be shown
            problems.append(message_text(error))
    try:
        trained = TrainedSource(take, _fps(take, opened))
        opened.numbers = trained.numbers
        opened.sources[trained.name] = trained
    except StudioError as error:
        if error.code != "take.not_trained":
            problems.append(message_text(error))
    opened.message = "\n".join(dict.fromkeys(problems))  # each once: trained frames need the edits, too
    return opened


def _fps(take: Take, opened: Opened) -> float:
    """Frame rate of the stream, else of the settings, else `FALLBACK_FPS`."""
    if opened.default is not None:
        return opened.default.fps
    try:
        capture = load_config(take.config).capture
        return (capture.fps or FALLBACK_FPS) / capture.frame_range[2]
    except StudioError:
        return FALLBACK_FPS


def take_contents(take: Take) -> tuple[object, ...]:
    """A cheap fingerprint that changes when a frame is added, a group was trained again or a stream is baked."""
    paths, counts = [take.stream / "manifest.json", take.rig, take.edits], list[int]()
    while (folder := take.finished_frame(len(counts), 0).parent).is_dir():
        frames = sorted(folder.glob("frame_*.safetensors"))
        counts.append(len(frames))
        paths += [*frames[:1], *frames[-1:]]
    return *counts, *(path.stat().st_mtime_ns if path.is_file() else 0 for path in paths)
