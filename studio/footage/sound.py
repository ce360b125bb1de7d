"""The sound of a capture: which file it is, and when it begins."""

import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from v3studio.studio.audio import Cut, SoundFile, cut_sound
from v3studio.studio.capture.frame_sources import FrameSource
from v3studio.studio.capture.patterns import VIDEO_EXTENSIONS
from v3studio.studio.capture.settings import CaptureSettings
from v3studio.studio.errors import StudioError


@dataclass(frozen=True)
class CaptureSound:
    """The sound of a capture's footage: seconds from the first frame to the file's time 0, that frame's number, fps."""

    file: SoundFile
    start: float
    first: int
    fps: float

    @property
    def path(self) -> Path:
        """The file."""
        return self.file.path

    def cut(self, frames: tuple[int, ...], step: int) -> Cut:
        """The sound of these frames, of every `step`-th one. Raises StudioError: `audio.uneven_frames`, or outside."""
        for before, after in itertools.pairwise(frames):
            if after - before != step:
                raise StudioError(
                    "audio.uneven_frames",
                    f"frame {after} follows frame {before}, so that the take has no steady clock for the sound",
                    file=self.path,
                    value=(before, after),
                    fix="Add the missing frames, or set capture.audio to null.",
                    setting="capture.audio",
                    expected=step,
                )
        begin = (frames[0] - self.first) / self.fps - self.start
        return cut_sound(self.file, begin, len(frames) * step / self.fps)


def find_sound(spec: CaptureSettings, sources: Mapping[str, FrameSource], fps: float) -> CaptureSound | None:
    """Find and open the sound that `spec.audio` names, for footage at `fps`; None if it names none."""
    if spec.audio is None:
        return None
    path, lag = spec.root / spec.audio, 0.0
    if spec.audio in sources and not path.is_file():
        source = sources[spec.audio]
        path = source.files([source.frames[0]])[0]
        if path.suffix.lower() not in VIDEO_EXTENSIONS:
            problem = f"capture.audio: camera '{spec.audio}' is a sequence of images, which have no sound"
            fix = "Set capture.audio to an audio file, or to null."
            raise StudioError("audio.camera_of_images", problem, value=spec.audio, fix=fix, setting="capture.audio")
        if len(source.files()) > 1:
            problem = f"capture.audio: the recording of camera '{spec.audio}' is in {len(source.files())} files"
            fix = "Join their sound into one file, and set capture.audio to that."
            raise StudioError("audio.several_files", problem, value=spec.audio, fix=fix, setting="capture.audio")
        # A camera that is late by some frames is late with its sound, too.
        lag = -spec.offsets.get(spec.audio, 0) / fps
    elif not path.is_file():
        problem = f"capture.audio: '{spec.audio}' is neither a file in {spec.root} nor a camera"
        fix = f"Cameras: {', '.join(sources)}."
        raise StudioError(
            "audio.not_found", problem, value=spec.audio, fix=fix, setting="capture.audio", known=tuple(sources)
        )
    # Frames of shifted cameras have other numbers than in their files; the footage starts where the files do.
    first = min(source.frames[0] + spec.offsets.get(name, 0) for name, source in sources.items())
    return CaptureSound(SoundFile(path), spec.audio_offset + lag, first, fps)
