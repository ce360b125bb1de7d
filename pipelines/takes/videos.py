"""Opens the Gaussian video of a take, a stream or a URL."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from pipelines.takes.locate_stream import stream_place
from pipelines.takes.take import Take
from studio.errors import StudioError

if TYPE_CHECKING:
    from studio.splat_video import SplatVideo
    from studio.stream import StreamReader

FALLBACK_FPS = 30.0
"""Frame rate if neither the settings nor the stream specify one, as for footage of still images."""


def is_take(text: str) -> bool:
    """`text` is the folder of a take."""
    return "://" not in text and (Path(text).expanduser() / "take.json").is_file()


def trained_video(root: Path) -> SplatVideo:
    """Trained frames of a take, up to the first missing one.

    Raises:
        StudioError: not a take (see `Take.open`), or no trained frames (`take.not_trained`).
    """
    from pipelines.config import load_config
    from pipelines.takes.frame_files import read_frame
    from studio.camera_files import read_rig
    from studio.splat_video import SplatVideo

    take = Take.open(root)
    files, starts = take.trained_files()
    if not files:
        raise StudioError(
            "take.not_trained", "no trained frames yet", file=root, fix="Run `v3studio train`.", stage="train"
        )
    capture = load_config(take.config if take.config.is_file() else None).capture
    rig = read_rig(take.rig) if take.rig.is_file() else None
    fps = None if capture.fps is None else capture.fps / capture.step
    if fps is None and (take.stream / "manifest.json").is_file():
        from studio.stream import StreamReader

        with StreamReader.open(take.stream) as reader:
            fps = reader.fps
    return SplatVideo(
        name=str(root),
        fps=float(fps or FALLBACK_FPS),
        frame_count=len(files),
        group_starts=starts,
        read=lambda index: read_frame(files[index]),
        up=None if rig is None else rig.up,
        view=None if rig is None else next(iter(rig)).undistorted(),
        background=(capture.background[0], capture.background[1], capture.background[2]),
    )


def decoded_video(reader: StreamReader) -> SplatVideo:
    """Frames of a stream as players decode them."""
    import numpy as np

    from studio.splat_video import SplatVideo
    from studio.stream import StreamMetadata

    metadata = StreamMetadata.from_json(reader.manifest.metadata)
    camera, up = metadata.suggested_camera, metadata.up
    return SplatVideo(
        name=reader.source.name,
        fps=reader.fps,
        frame_count=reader.frame_count,
        group_starts=reader.group_starts,
        read=reader.gaussians,
        up=None if up is None else np.array(up, np.float64),
        view=None if camera is None else camera.undistorted(),
        background=metadata.background or (0.0, 0.0, 0.0),
    )


def open_reader(text: str) -> StreamReader:
    """Open a stream from its folder, the folder of a take, or a URL. The caller closes it.

    Raises:
        StudioError: see `pipelines.takes.locate_stream.stream_place` and `StreamReader.open`.
    """
    from studio.stream import StreamReader

    return StreamReader.open(stream_place(text))
