"""Sequences of numbered PLY, SPZ or GLB files, one per frame. SuperSplat and other programs play PLY sequences."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from studio.export.placing import new_file, new_folder
from studio.export.rigid_motion import turned, upright
from studio.progress import ProgressFn, no_progress
from studio.splat_files import SPZ_VERSION, UP, write_splats
from studio.splat_video import SplatVideo


def axes_of(video: SplatVideo, ending: str, upright_for_viewers: bool) -> np.ndarray | None:
    """The (3, 3) rotation to apply for a file format, or None to keep the world axes.

    Args:
        video: provides the up and front directions.
        ending: ".ply", ".spz" or ".glb".
        upright_for_viewers: rotate to the up convention of the format, with the side that faces the video's view to the
            front.
    """
    if not upright_for_viewers:
        return None
    rotation = upright(video)
    # 3DGS files have y down and z pointing away from the viewer: 180 degrees about x
    return np.diag([1.0, -1.0, -1.0]) @ rotation if UP[ending][1] < 0 else rotation


def export_sequence(
    video: SplatVideo,
    folder: Path,
    ending: str,
    rotation: np.ndarray | None = None,
    progress: ProgressFn = no_progress,
    spz_version: int = SPZ_VERSION,
) -> None:
    """Write `folder/frame_0000.ply`, ..., numbered as in the video.

    Args:
        video: the frames.
        folder: must not exist; appears only when it is complete.
        ending: ".ply", ".spz" or ".glb".
        rotation: (3, 3) rotation from `axes_of`; None: no rotation.
        progress: called with written and total frames.
        spz_version: of .spz files, 3 or 4.

    Raises:
        StudioError: a frame cannot be read or represented in the format, or the folder exists or cannot be written.
    """
    digits = max(4, len(str(max(video.number(index) for index in range(video.frame_count)))))
    with new_folder(folder) as temporary:
        for index in range(video.frame_count):
            progress(index, video.frame_count)
            gaussians = video.read(index)
            if rotation is not None:
                gaussians = turned(gaussians, rotation)
            write_splats(temporary / f"frame_{video.number(index):0{digits}d}{ending}", gaussians, spz_version)
        progress(video.frame_count, video.frame_count)


def export_frame(
    video: SplatVideo, path: Path, rotation: np.ndarray | None = None, spz_version: int = SPZ_VERSION
) -> None:
    """Write the first frame to a file, in the format of its extension. Raises StudioError as `export_sequence`."""
    gaussians = video.read(0)
    if rotation is not None:
        gaussians = turned(gaussians, rotation)
    with new_file(path) as temporary:
        write_splats(temporary, gaussians, spz_version)
