"""Views of a take's camera path in the frames and the world of what is exported of the take."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from pipelines.takes.edits import read_edits
from pipelines.takes.frame_numbers import FrameNumbers, trained_numbers
from pipelines.takes.take import Take
from pipelines.takes.videos import capture_place, decoded_video, open_reader, trained_video
from studio.errors import StudioError

if TYPE_CHECKING:
    from studio.formats.camera_path import Key
    from studio.stream import CapturePlace


def in_export(keys: Sequence[Key], source: str, of: str, numbers: FrameNumbers) -> list[Key]:
    """The keys, which count frames and lie as in the take, as `v3studio export` takes them.

    Args:
        source: folder of the take; or of a stream, or its URL.
        of: "decoded" or "trained"; "" for a stream, in whose own frames and world the keys are.
    """
    place, count = _place_of(source, of)
    first, last = place.first_frame, place.first_frame + count - 1
    frames = [int(key.frame or 0) for key in keys]
    left_out = {number: frame for number, frame in enumerate(frames, 1) if not first <= frame <= last}
    if left_out:
        views = ", ".join(f"view {number} (frame {numbers.number(frame)})" for number, frame in left_out.items())
        raise StudioError(
            "export.frames_left_out",
            f"the camera path shows frames that the movie cannot have: {views}; "
            f"it can have {numbers.number(first)} to {numbers.number(last)}",
            value=list(left_out.values()),
            fix="Drag their diamonds on the timeline to other frames, or remove these views.",
            expected=[first, last],
        )
    return [
        replace(key, camera=place.camera(key.camera), frame=float(frame - first))
        for key, frame in zip(keys, frames, strict=True)
    ]


def _place_of(source: str, of: str) -> tuple[CapturePlace, int]:
    """Where what is exported of a take lies in the take, and its number of frames."""
    from studio.stream import CapturePlace

    if of != "trained":
        with open_reader(source) as reader:
            place, original = capture_place(reader) if of else CapturePlace(), decoded_video(reader).original
            return CapturePlace(place.first_frame, original.after(place.world)), reader.frame_count
    take, video = Take.open(Path(source)), trained_video(source)
    first, world = trained_numbers(take).index(video.number(0)) or 0, read_edits(take.edits).similarity
    return CapturePlace(first, video.original.after(world)), video.frame_count
