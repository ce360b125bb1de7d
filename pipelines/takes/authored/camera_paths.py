"""Camera paths for a video: from any file that has one, and a take's own as exports take it."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from v3studio.pipelines.takes.authored.edits import read_edits
from v3studio.pipelines.takes.frames.frame_numbers import FrameNumbers, trained_numbers
from v3studio.pipelines.takes.results.videos import (
    capture_place,
    decoded_video,
    open_reader,
    stream_numbers,
    trained_video,
)
from v3studio.pipelines.takes.take import Take
from v3studio.studio.errors import StudioError
from v3studio.studio.formats import EXPORTS
from v3studio.studio.formats.camera_path import FILM_FORMATS, Key, read_film_keys, read_path_keys
from v3studio.studio.formats.sequence import axes_of
from v3studio.studio.similarity import Similarity
from v3studio.studio.splat_video import SplatVideo
from v3studio.studio.stream import CapturePlace

PATH_SUFFIXES = (".json", *FILM_FORMATS)  # extensions of files with a camera path


def film_world(video: SplatVideo, *, upright: bool = True) -> Similarity:
    """The transform from the world of a video's splats to that of film tools and exported USD: y up if `upright`."""
    rotation = axes_of(video, EXPORTS["exr"].up, upright)
    return video.original if rotation is None else Similarity(video.original.scale, rotation)


def path_keys(
    video: SplatVideo,
    path: Path,
    *,
    camera: str | None = None,
    size: tuple[int, int] = (1280, 720),
    seconds: float | None = None,
    numbers: Sequence[int] = (),
    upright: bool = True,
) -> list[Key]:
    """The keys of a camera path in the world of the video's splats.

    Args:
        video: the splats; key frames are its indices.
        path: a file with one of `PATH_SUFFIXES`, or another that `read_rig` reads.
        camera: name of the camera in a file of a film tool; None: it has only one.
        seconds: over which the cameras of a rig are spread; None: the video's duration.
        numbers: of the video's frames in the film tool; none: `SplatVideo.number`.
    """
    if path.suffix.lower() in FILM_FORMATS:
        known = numbers or [video.number(index) for index in range(video.frame_count)]
        keys = read_film_keys(path, camera, size, known, video.fps)
        back = film_world(video, upright=upright).inverse
    elif camera is not None:
        problem = f"only files with {', '.join(FILM_FORMATS)} have cameras with names, not this one"
        raise StudioError("camera_path.which_camera", problem, file=path, value=camera, fix="Remove --camera.")
    else:
        keys = read_path_keys(path, video.duration if seconds is None else seconds)
        back = video.original.inverse
    return [replace(key, camera=back.camera(key.camera)) for key in keys]


def keys_in_take(source: str, of: str, path: Path, camera: str | None = None) -> list[Key]:
    """The keys of a camera path in the world of a take before its edits, with the numbers of their frames; `path` and
    `camera` as for `path_keys`. A camera that stands still has a key at both ends of the video.

    `source`: folder of a take; or of a stream, or its URL, whose own world and numbers count. `of`: "decoded" or
    "trained", the frames that `v3studio export` would read; "" for a stream.
    """
    if of == "trained":
        video, world = trained_video(source), read_edits(Take.open(Path(source)).edits).similarity
    else:
        with open_reader(source) as reader:
            video = replace(decoded_video(reader), numbers=stream_numbers(source, reader).known)
            world = capture_place(reader).world if of else Similarity()
    keys = path_keys(video, path, camera=camera)
    if len(keys) == 1:
        keys = [keys[0], replace(keys[0], time=keys[0].time + video.duration - 1 / video.fps)]
    placed = []
    for key in keys:
        index = round(key.time * video.fps if key.frame is None else key.frame)
        if 0 <= index < video.frame_count:
            placed.append(replace(key, camera=world.inverse.camera(key.camera), frame=float(video.number(index))))
    return placed


def in_export(keys: Sequence[Key], source: str, of: str, numbers: FrameNumbers) -> list[Key]:
    """Keys that count frames and lie as in the take, as `v3studio export` takes them; arguments as `keys_in_take`."""
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
    """The place in a take of what is exported of it, and its number of frames."""
    if of != "trained":
        with open_reader(source) as reader:
            place, original = capture_place(reader) if of else CapturePlace(), decoded_video(reader).original
            return CapturePlace(place.first_frame, original.after(place.world)), reader.frame_count
    take, video = Take.open(Path(source)), trained_video(source)
    first, world = trained_numbers(take).index(video.number(0)) or 0, read_edits(take.edits).similarity
    return CapturePlace(first, video.original.after(world)), video.frame_count
