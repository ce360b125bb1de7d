"""The base of the writers of all formats."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from v3studio.pipelines.export.source import Source
from v3studio.pipelines.outputs import replacing
from v3studio.studio.capture.frame_range import ALL_FRAMES
from v3studio.studio.errors import StudioError
from v3studio.studio.formats import Format

if TYPE_CHECKING:
    from v3studio.studio.progress import ProgressFn
    from v3studio.studio.splat_video import SplatVideo


@dataclass(frozen=True)
class Written:
    """The result of an export: a number of frames, more words about it, notes (sentences; "" for none), and its size
    in bytes if that is told."""

    frames: int
    more: str = ""
    notes: tuple[str, ...] = ()
    bytes: int | None = None


@dataclass(frozen=True, kw_only=True)
class Writer(ABC):
    """Writes a source to a file or folder. The fields of a writer, except for these, are the options of `v3studio
    export` that its format takes beside `Format.options`, with their defaults."""

    format: Format
    source: Source
    out: Path
    overwrite: bool
    options: Mapping[str, Any]  # `Format.options` that were given, by their keywords

    @abstractmethod
    def write(self, progress: ProgressFn) -> Written:
        """Write it. StudioError: options that cannot be used (`command.invalid_option`), an output that is in the way
        (`output.exists`, `output.not_ours`), or as the source and the format."""

    def is_earlier(self, out: Path) -> bool:
        """Return whether a file or folder may be an earlier export in this format: a folder holds nothing else."""
        files = [out] if out.is_file() else [path for path in out.rglob("*") if not path.is_dir()]
        return all(path.suffix.lower() in self.suffixes for path in files)

    @property
    def suffixes(self) -> tuple[str, ...]:
        """Extensions of the files that it writes, in lower case."""
        return (self.format.suffix,)


@dataclass(frozen=True, kw_only=True)
class VideoWriter(Writer):
    """Writes the chosen frames, which are read one by one."""

    of: str | None = None
    frames: tuple[int | None, int | None, int] = ALL_FRAMES  # first number, number after the last, step
    sh_degree: int | None = None  # None: all

    has_sound: ClassVar[bool] = False

    def write(self, progress: ProgressFn) -> Written:
        video = self.source.video(self.of)
        if self.has_sound:
            video = replace(video, sound=self.source.sound(self.of, video))
        if self.sh_degree is not None:
            read, degree = video.read, self.sh_degree
            video = replace(video, read=lambda index: read(index).with_sh_degree(degree))
        if self.frames != ALL_FRAMES:
            video = video.part(*self.frames)
        with replacing(self.out, self.overwrite, self.is_earlier):
            return self.written(video, progress)

    @abstractmethod
    def written(self, video: SplatVideo, progress: ProgressFn) -> Written:
        """Write the video to `out`, which does not exist."""


def film_numbers(video: SplatVideo, first: int | None) -> tuple[int, ...]:
    """The frame numbers for film tools: from `first` on, None: those of the footage."""
    indices = range(video.frame_count)
    return tuple(video.number(index) if first is None else first + index for index in indices)


def wrong_option(option: str, problem: str, fix: str, value: Any = None, file: Path | str | None = None) -> StudioError:
    """The error for an option that cannot be used."""
    return StudioError("command.invalid_option", problem, file=file, value=value, fix=fix, option=option)
