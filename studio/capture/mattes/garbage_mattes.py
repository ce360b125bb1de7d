"""Garbage mattes: parts of the image that can never contain the performer."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from studio.capture.frame_sources import DecoderPool, make_sources
from studio.capture.mattes.matte_source import FileMatteSource
from studio.capture.patterns import VIDEO_EXTENSIONS, Match, find_files
from studio.capture.settings import CaptureSettings
from studio.errors import StudioError


class GarbageMattes:
    """One image per camera, or per camera and frame; black excludes. Cameras without a garbage matte keep the whole
    image.

    Args:
        matches: the files; an image without a frame number applies to all frames of its camera.
        pool: bounds the number of open decoders.
        offsets: camera to sync offset in frames, as in `CaptureSettings`; applies to files with a frame number and to
            videos.

    Raises:
        StudioError: a file cannot be opened.
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
        """(H, W) bool, where the performer may be in the raw `image` (H, W, ...); None: everywhere.

        Raises:
            StudioError: the file cannot be read, `matte.aspect_ratio`, or `footage.no_such_frame`.
        """
        if camera not in self._cameras:
            return None
        return self._matte_source.matte(camera, 0 if camera in self._still else frame, image) > 127

    def files(self) -> list[Path]:
        """The files from which they are read."""
        return self._matte_source.files()


def garbage_mattes(spec: CaptureSettings, names: tuple[str, ...], pool: DecoderPool) -> GarbageMattes | None:
    """The garbage mattes `spec.garbage_mattes` of the cameras `names`; None if the setting is empty.

    Raises:
        StudioError: `matte.garbage_not_found`, or a file cannot be opened.
    """
    if not spec.garbage_mattes:
        return None
    matches = [match for match in find_files(spec.root, spec.garbage_mattes) if match.camera in names]
    if not matches:
        raise StudioError(
            "matte.garbage_not_found",
            f"no garbage matte of the footage's cameras matches the pattern '{spec.garbage_mattes}'",
            file=spec.root,
            value=spec.garbage_mattes,
            fix="Check capture.garbage_mattes.",
            setting="capture.garbage_mattes",
        )
    return GarbageMattes(matches, pool, spec.offsets)
