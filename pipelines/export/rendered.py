"""Writers of rendered images: movies, and plates for compositing."""

import operator
from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from v3studio.pipelines.export.writer import VideoWriter, Written, film_numbers, wrong_option
from v3studio.pipelines.takes.authored.camera_paths import film_world, path_keys
from v3studio.studio.cameras import Camera, Rig
from v3studio.studio.errors import naming
from v3studio.studio.formats.camera_path import FILM_FORMATS, CameraPath, Key, turntable
from v3studio.studio.formats.exr import export_exr
from v3studio.studio.formats.movie import movie_sound, render_movie
from v3studio.studio.formats.plates import Shutter
from v3studio.studio.progress import ProgressFn
from v3studio.studio.splat_video import SplatVideo

_SIZE = (1280, 720)
_TURNTABLE_SECONDS = 6.0  # shortest turn; a faster one is hard to watch

Views = tuple[Callable[[float], Camera], Callable[[float], float], float]
"""A movie's camera and frame at a number of seconds, and its duration in seconds."""


@dataclass(frozen=True, kw_only=True)
class _Movie(VideoWriter):
    """Renders an MP4."""

    size: tuple[int, int] = _SIZE
    seconds: float | None = None  # None: as long as the path or the source
    fps: float | None = None  # None: that of the source
    crf: int = 18
    background: tuple[float, float, float] | None = None  # None: the set, and that of the source
    has_sound = True

    @abstractmethod
    def views(self, video: SplatVideo) -> Views:
        """The camera and the frame of each image."""

    def written(self, video: SplatVideo, progress: ProgressFn) -> Written:
        if self.background is not None:
            video = replace(video, background=self.background, behind=lambda: None)
        camera, frame, seconds = self.views(video)
        fps = video.fps if self.fps is None else self.fps
        count = render_movie(video, self.out, camera, frame, seconds, fps, self.crf, progress)
        sound, why = movie_sound(video, frame, seconds, fps)
        heard = ", with sound" if sound is not None else f", without sound: {why}" if why else ""
        return Written(count, f" of {self.size[0]}x{self.size[1]}{heard}")


@dataclass(frozen=True, kw_only=True)
class Turntable(_Movie):
    """Renders a movie of a camera that circles the performer."""

    turns: float = 1.0
    elevation: float = 10.0  # degrees

    def views(self, video: SplatVideo) -> Views:
        seconds = max(video.duration, _TURNTABLE_SECONDS) if self.seconds is None else self.seconds
        circling = turntable(video, *self.size, turns=self.turns, elevation=self.elevation)
        return lambda at: circling(at / seconds), partial(operator.mul, video.fps), seconds


@dataclass(frozen=True, kw_only=True)
class PathMovie(_Movie):
    """Renders a movie along a camera path."""

    path: Path
    camera: str | None = None
    axes: str | None = None
    start_number: int | None = None

    def views(self, video: SplatVideo) -> Views:
        with naming(self.path):
            keys = path_keys(
                video,
                self.path,
                camera=self.camera,
                size=self.size,
                seconds=self.seconds,
                numbers=film_numbers(video, self.start_number),
                upright=self.axes != "world",
            )
            film = self.path.suffix.lower() in FILM_FORMATS and len(keys) > 1
            if film:  # its camera may move before and after the video
                keys = [key for key in keys if key.frame is not None and 0 <= key.frame < video.frame_count]
            path = CameraPath(keys, *self.size)
        usual = (path.duration + 1 / video.fps if film else path.duration) or video.duration
        frame = path.frame if path.has_frames else partial(operator.mul, video.fps)
        return path.camera, frame, usual if self.seconds is None else self.seconds


@dataclass(frozen=True, kw_only=True)
class Plates(VideoWriter):
    """Renders one EXR file per frame along a camera path, or from a camera of the footage."""

    path: Path | None = None
    camera: str | None = None
    axes: str | None = None
    start_number: int | None = None
    size: tuple[int, int] | None = None  # None: that of the footage's camera, else 1280x720
    color_space: str = "acescg"
    overscan: int = 0  # pixels on each side
    shutter: float = 0.0  # degrees
    shutter_samples: int = 16
    mattes: int = 0
    deep: int = 0  # samples per pixel

    def __post_init__(self) -> None:
        if self.path is None and self.camera is None:
            either = "--path FILE or --camera NAME"
            raise wrong_option("--path", f"--format {self.format.name} needs {either}", f"Add {either}.")

    def written(self, video: SplatVideo, progress: ProgressFn) -> Written:
        numbers, upright = film_numbers(video, self.start_number), self.axes != "world"
        name, path = self._of_footage() if self.path is None else self._along(self.path, video, numbers, upright)

        def camera(index: float) -> Camera:
            seconds = path.seconds_of(index) if path.has_frames else index / video.fps
            return replace(path.camera(seconds), name=name)

        written = export_exr(
            replace(video, numbers=numbers),
            self.out,
            camera,
            film_world(video, upright=upright),
            self.color_space,
            self.overscan,
            Shutter(self.shutter, self.shutter_samples),
            self.mattes,
            self.deep,
            progress,
        )
        return Written(video.frame_count, f" of {camera(0).width}x{camera(0).height}, {written:,} bytes")

    def _of_footage(self) -> tuple[str, CameraPath]:
        """The name and the view of a camera of the footage."""
        assert self.camera is not None
        rig = Rig(self.source.cameras(self.of))
        if not rig.cameras:
            problem = f"--camera {self.camera} needs a take with cameras"
            raise wrong_option("--camera", problem, "Add --path FILE.", self.camera, self.source.place)
        chosen = rig[self.camera]
        return chosen.name, CameraPath([Key(0.0, chosen)], *(self.size or (chosen.width, chosen.height)))

    def _along(self, file: Path, video: SplatVideo, numbers: tuple[int, ...], upright: bool) -> tuple[str, CameraPath]:
        """The name and the views of a camera path."""
        size = self.size or _SIZE
        with naming(file):
            keys = path_keys(video, file, camera=self.camera, size=size, numbers=numbers, upright=upright)
            path = CameraPath(keys, *size)
            if path.has_frames:
                path.seconds_of(0)  # raises if frames do not ascend
        return self.camera or file.stem, path
