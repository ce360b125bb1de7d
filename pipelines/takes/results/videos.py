"""Finds and opens the Gaussian video of a take, a stream or a URL."""

from __future__ import annotations

import os
from bisect import bisect_right
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from v3studio.pipelines.config import load_config
from v3studio.pipelines.takes.authored.edits import no_frames_left, read_edits
from v3studio.pipelines.takes.frames.frame_numbers import FrameNumbers, trained_groups, trained_numbers
from v3studio.pipelines.takes.frames.take_set import take_set
from v3studio.pipelines.takes.take import Take
from v3studio.studio.camera_files import read_rig
from v3studio.studio.edits.edit_list import UP
from v3studio.studio.errors import StudioError
from v3studio.studio.own_frame import in_own_frame, own_frame, undone
from v3studio.studio.similarity import Similarity

if TYPE_CHECKING:
    from v3studio.studio.cameras import Camera
    from v3studio.studio.gaussians import Gaussians
    from v3studio.studio.splat_video import SplatVideo
    from v3studio.studio.stream import CapturePlace, StreamReader


FALLBACK_FPS = 30.0  # frame rate if neither the settings nor the stream specify one, as for footage of still images


def is_take(text: str) -> bool:
    return "://" not in text and (Path(text).expanduser() / "take.json").is_file()


def trained_video(root: str | os.PathLike[str]) -> SplatVideo:
    """Trained frames of a take, up to the first missing one, with the take's edits.

    Example:
        >>> video = v3.trained_video("my-take")
        >>> video.frame_count, video.fps, video.read(0).means.shape[1]
        (5, 25.0, 3)

    Raises:
        StudioError: not a take (see `Take.open`), no trained frames (`take.not_trained`), the edits cannot be read
            (`take.edits_*`), or none of the trained frames is within the trim (`edits.no_frames_left`).
    """
    from v3studio.pipelines.takes.frames.edited import EditedGroup
    from v3studio.studio.formats.rigid_motion import placed
    from v3studio.studio.splat_video import SplatVideo

    root = Path(root)
    take = Take.open(root)
    files, starts = take.trained_files()
    if not files:
        problem = "no trained frames yet"
        raise StudioError("take.not_trained", problem, file=root, fix="Run `v3studio train`.", stage="train")
    config = load_config(take.config if take.config.is_file() else None)
    capture, background = config.capture, config.evaluate.background
    given = read_rig(take.rig) if take.rig.is_file() else None
    rig = None if given is None else in_own_frame(given)
    fps = None if capture.fps is None else capture.fps / capture.frame_range[2]
    if fps is None and take.has_stream:
        with open_reader(str(take.root)) as reader:
            fps = reader.fps
    edits = read_edits(take.edits)
    world, trim = edits.similarity, edits.trim
    trained = trained_groups(take)
    groups, numbers = [EditedGroup(take, group, edits) for group in trained], FrameNumbers.of(trained)
    up = None if rig is None else world.directions(rig.up)
    if edits.world is not None and edits.world.up is not None:
        up = np.array(UP)
    view = None if rig is None else next(iter(rig)).undistorted()

    def behind() -> Gaussians | None:
        splats = take_set(take)
        return None if splats is None else placed(splats, world)

    video = SplatVideo(
        name=str(root),
        fps=float(fps or FALLBACK_FPS),
        frame_count=len(files),
        group_starts=starts,
        read=lambda index: groups[bisect_right(starts, index) - 1].read(index),
        up=up,
        view=view if view is None or world.is_identity else world.camera(view),
        background=(background[0], background[1], background[2]),
        behind=behind,
        numbers=numbers.known,
        original=Similarity() if given is None else undone(own_frame(given), placed=edits.world is not None),
    )
    if trim is None:
        return video
    kept = [frame for frame in numbers.known if trim.holds(frame)]
    if not kept:
        raise no_frames_left(take, trim, numbers.known)
    return video.part(kept[0], kept[-1] + 1)


def decoded_video(reader: StreamReader) -> SplatVideo:
    """Frames of a stream as players decode them."""
    from v3studio.studio.splat_video import SplatVideo
    from v3studio.studio.stream import StreamMetadata

    metadata = StreamMetadata.from_json(reader.manifest.metadata)
    camera, up = metadata.suggested_camera, metadata.up
    return SplatVideo(
        name=reader.source.name,
        fps=reader.fps,
        frame_count=reader.frame_count,
        group_starts=reader.index.starts,
        read=reader.gaussians,
        up=None if up is None else np.array(up, np.float64),
        view=None if camera is None else camera.undistorted(),
        background=metadata.background or (0.0, 0.0, 0.0),
        behind=reader.set_splats,
        original=metadata.original,
    )


def footage_cameras(source: str, *, decoded: bool) -> tuple[Camera, ...]:
    """The cameras of a take's footage, refined ones if training used them, in the world of its splats: with `decoded`,
    those of its stream, which may have been baked before the last edits. () for sources that are no take."""
    if not is_take(source):
        return ()
    take = Take.open(Path(source).expanduser())
    file = take.refined_rig if take.refined_rig.is_file() else take.rig
    if not file.is_file():
        return ()
    world = read_edits(take.edits).similarity
    if decoded:
        with open_reader(source) as reader:
            world = capture_place(reader).world
    return tuple(world.camera(camera.undistorted()) for camera in in_own_frame(read_rig(file)))


def open_reader(text: str) -> StreamReader:
    """Open a stream from its folder, the folder of a take, or a URL; StudioError as `stream_place` and
    `StreamReader.open`. The caller closes it."""
    from v3studio.studio.stream import StreamReader

    return StreamReader.open(stream_place(text))


def capture_place(reader: StreamReader) -> CapturePlace:
    """The place of a stream in the take that it was baked from; the identity for streams without edits."""
    from v3studio.studio.stream import CapturePlace, StreamMetadata

    return StreamMetadata.from_json(reader.manifest.metadata).capture or CapturePlace()


def stream_numbers(text: str, reader: StreamReader) -> FrameNumbers:
    """The frame numbers of a stream that was opened from `text`: those in the footage for a take's, else from 0."""
    if not is_take(text):
        return FrameNumbers()
    trained, first = trained_numbers(Take.open(Path(text).expanduser())), capture_place(reader).first_frame
    return FrameNumbers(tuple(trained.number(first + index) for index in range(reader.frame_count)))


def stream_place(text: str) -> Path | str:
    """The folder, one-file stream or URL of a stream; for a take, the folder of its stream."""
    if "://" in text:
        return text
    folder = Path(text).expanduser()
    if folder.name in ("manifest.json", "take.json") and folder.is_file():
        folder = folder.parent
    if folder.is_file():
        return folder
    if not (folder / "take.json").is_file():
        if not folder.is_dir():
            fix = "Specify the folder of a stream or of a take."
            raise StudioError("stream.not_found", "no such folder", file=text, fix=fix)
        return folder
    take = Take.open(folder)
    if not take.has_stream:
        fix = "Run `v3studio run` or `v3studio bake`."
        raise StudioError("take.no_stream", "this take has no stream yet", file=text, fix=fix, stage="bake")
    return take.stream
