"""Writers of splats: files per frame, sequences, and the whole stream."""

from abc import abstractmethod
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from v3studio.pipelines.export.writer import VideoWriter, Writer, Written, film_numbers, wrong_option
from v3studio.pipelines.outputs import replacing
from v3studio.studio.counts import counted
from v3studio.studio.dilation import DILATION
from v3studio.studio.formats import USD_SUFFIXES
from v3studio.studio.formats.placing import new_file
from v3studio.studio.formats.sequence import axes_of, export_frame, export_sequence
from v3studio.studio.formats.usd import export_usd
from v3studio.studio.formats.videogs import export_videogs, is_videogs
from v3studio.studio.gaussians import Gaussians
from v3studio.studio.progress import ProgressFn
from v3studio.studio.splat_video import SplatVideo
from v3studio.studio.stream.write_archive import write_archive


@dataclass(frozen=True, kw_only=True)
class StreamFile(Writer):
    """Writes the stream as it is to one file."""

    of: str | None = None

    def write(self, progress: ProgressFn) -> Written:
        suffix = self.format.suffix
        if self.of in ("trained", "set"):
            problem = f"--format {self.format.name} has no --of {self.of}: the stream is written as it is"
            raise wrong_option("--of", problem, "Remove --of.", self.of)
        if self.out.suffix.lower() != suffix:
            problem = f"--format {self.format.name} writes a {suffix} file"
            fix = f"End the name with {suffix}, by which players recognize it."
            raise wrong_option("--out", problem, fix, self.out.suffix, self.out)
        reader = self.source.reader
        with replacing(self.out, self.overwrite, Path.is_file), new_file(self.out) as temporary:
            size = write_archive(reader, temporary, progress)
        return Written(reader.frame_count, f", {size:,} bytes", bytes=size)


@dataclass(frozen=True, kw_only=True)
class _SplatWriter(VideoWriter):
    """Writes splats, and notes what other programs will draw differently."""

    axes: str | None = None  # "world" or "viewer"; None: as is usual in the format

    @abstractmethod
    def files(self, video: SplatVideo, progress: ProgressFn) -> str:
        """Write the files; returns more words about them."""

    def written(self, video: SplatVideo, progress: ProgressFn) -> Written:
        dilations: set[float] = set()

        def read(index: int) -> Gaussians:
            gaussians = video.read(index)
            dilations.add(gaussians.dilation)
            return gaussians

        more = self.files(replace(video, read=read), progress)
        return Written(video.frame_count, more, (_dilation_note(dilations), self._place_note(video)))

    @property
    def _for_viewers(self) -> bool:
        return self.axes == "viewer" or (self.axes is None and not self.format.keeps_axes)

    def rotation(self, video: SplatVideo) -> np.ndarray | None:
        """The rotation to the axes of viewers; None to keep those of the capture."""
        return axes_of(video, self.format.up, self._for_viewers)

    def _place_note(self, video: SplatVideo) -> str:
        """The note on the world of the files, if it is not that of the splats."""
        if video.original.is_identity:
            return ""
        scale = f"in the original units (1 of them is {1 / video.original.scale:g} of the stream's)"
        if not video.original.translation.any():
            return scale
        if self._for_viewers:
            return f"{scale}, near zero; with --axes world, at the original place"
        doubles = ", with positions as doubles" if self.format.name == "ply" else ""
        return f"{scale}, at the original place{doubles}"


@dataclass(frozen=True, kw_only=True)
class SplatFiles(_SplatWriter):
    """Writes one file per frame."""

    def files(self, video: SplatVideo, progress: ProgressFn) -> str:
        out, suffix, rotation = self.out, self.format.suffix, self.rotation(video)
        if out.suffix.lower() != suffix:
            export_sequence(video, out, suffix, rotation, progress, **self.options)
        elif video.frame_count == 1:
            export_frame(video, out, rotation, **self.options)
        else:
            first = video.number(0)
            problem = f"{video.frame_count} frames cannot be written to one file"
            one_frame = f"select one frame with --frames {first}:{first + 1}"
            fix = f"Specify a folder, a name without {suffix}, or {one_frame}."
            raise wrong_option("--out", problem, fix, video.frame_count, out)
        return ""


@dataclass(frozen=True, kw_only=True)
class VideoGs(_SplatWriter):
    """Writes the VideoGS layout."""

    qp: int = 22

    def is_earlier(self, out: Path) -> bool:
        return is_videogs(out)

    def files(self, video: SplatVideo, progress: ProgressFn) -> str:
        if self.axes == "viewer":
            problem = "--axes viewer: the VideoGS layout supports only the axes of the capture"
            raise wrong_option("--axes", problem, "Remove --axes.", self.axes)
        export_videogs(video, self.out, qp=self.qp, progress=progress)
        return f", {counted(len(video.groups), 'group')}"


@dataclass(frozen=True, kw_only=True)
class Usd(_SplatWriter):
    """Writes one USD file, with the sound beside it where it cannot be inside."""

    start_number: int | None = None
    has_sound = True

    @property
    def suffixes(self) -> tuple[str, ...]:
        return USD_SUFFIXES

    def files(self, video: SplatVideo, progress: ProgressFn) -> str:
        cameras = self.source.cameras(self.of)
        rotation = self.rotation(video)
        video = replace(video, numbers=film_numbers(video, self.start_number))
        with ExitStack() as stack:
            if video.sound is not None and self.out.suffix.lower() != ".usdz":
                stack.enter_context(replacing(self.out.with_suffix(".wav"), self.overwrite, Path.is_file))
            export_usd(video, self.out, rotation, cameras, progress)
        parts = [counted(len(video.groups), "group")]
        parts += [counted(len(cameras), "camera")] if cameras else []
        parts += ["sound"] if video.sound is not None else []
        return "".join(f", {part}" for part in parts)


def _dilation_note(dilations: set[float]) -> str:
    """The note on frames that other programs draw with another dilation than these; "" if they draw them as trained."""
    others = sorted(dilations - {DILATION})
    if not others:
        return ""
    trained = " and ".join(f"{dilation:g}" for dilation in others)
    bolder, thinner = min(others) < DILATION, max(others) > DILATION
    look = "bolder or thinner" if bolder and thinner else "bolder and softer" if bolder else "thinner"
    return (
        f"viewers of these files assume a dilation of {DILATION:g} square pixels; the splats were trained with "
        f"{trained} and look {look} there"
    )
