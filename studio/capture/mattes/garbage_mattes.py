"""Garbage mattes: what of a camera's picture is looked at for the performer at all."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from studio.capture.frame_sources import DecoderPool, make_sources
from studio.capture.mattes.matte_source import FileMatteSource
from studio.capture.patterns import VIDEO_EXTENSIONS, Match, find_files
from studio.capture.spec import CaptureSpec
from studio.errors import StudioError


class GarbageMattes:
    """A picture a camera, or one a camera and frame: white is kept. Cameras without one keep all of their picture.

    Args:
        matches: the files; an image without a frame number holds for all frames of its camera.
        offsets: frames that cameras are late, as in `CaptureSpec`; for files that are one a frame.
    """

    def __init__(self, matches: list[Match], pool: DecoderPool, offsets: Mapping[str, int] | None = None) -> None:
        self._cameras = {match.camera for match in matches}
        self._still = {
            match.camera
            for match in matches
            if match.frame is None and match.path.suffix.lower() not in VIDEO_EXTENSIONS
        }
        moving = {camera: offset for camera, offset in (offsets or {}).items() if camera not in self._still}
        self._matte_source = FileMatteSource(make_sources(matches, pool, offsets=moving))

    def inside(self, camera: str, frame: int, image: np.ndarray) -> np.ndarray | None:
        """(H, W) bool, where the performer may be in the raw `image`; None is everywhere.

        Raises:
            StudioError: the file cannot be read, has another aspect ratio, or there is none for this frame.
        """
        if camera not in self._cameras:
            return None
        return self._matte_source.matte(camera, 0 if camera in self._still else frame, image) > 127

    def files(self) -> list[Path]:
        """What they are read from."""
        return self._matte_source.files()


def garbage_mattes(spec: CaptureSpec, names: tuple[str, ...], pool: DecoderPool) -> GarbageMattes | None:
    """Those that `spec.garbage_mattes` names for the cameras `names`; None where the capture has none.

    Raises:
        StudioError: the pattern fits nothing, or a file cannot be opened.
    """
    if not spec.garbage_mattes:
        return None
    matches = [match for match in find_files(spec.root, spec.garbage_mattes) if match.camera in names]
    if not matches:
        raise StudioError(f"{spec.root}: no garbage matte of the footage's cameras fits '{spec.garbage_mattes}'.")
    return GarbageMattes(matches, pool, spec.offsets)
