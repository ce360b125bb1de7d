"""Footage: frames x cameras of a capture, each an image with its matte and its camera."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from studio.cameras import Camera, Rig
from studio.capture.digest import digest_files
from studio.capture.frame_sources import DecoderPool, FrameSource
from studio.capture.lru_cache import ByteCache
from studio.capture.mattes.matte_source import MatteSource, PlateMatteSource, Recolors
from studio.capture.spec import CaptureSpec
from studio.capture.warp import Warp
from studio.errors import StudioError


@dataclass(frozen=True, eq=False)
class FootageView:
    """What one camera saw at one moment.

    Attributes:
        camera: pinhole camera that fits the image.
        image: (H, W, 3) uint8 RGB.
        matte: (H, W) uint8, 255 foreground.
        frame: frame number.
        plate: (H, W, 3) uint8 RGB, the empty set as this camera sees it; None where the capture has no clean plate.
    """

    camera: Camera
    image: np.ndarray
    matte: np.ndarray
    frame: int = 0
    plate: np.ndarray | None = None


class Footage:
    """See `open_footage`, which makes it. Thread safe; images are decoded when asked for, and cached within a bound.

    Attributes:
        spec: what it was opened with.
        camera_names: all cameras, in name order (2 before 10).
        train_cameras, held_out_cameras: the two parts of them.
        frames: frame numbers as in the files, after start, stop and step.
        fps: frames a second.
        description: one sentence a line on what was found and how it is read.
        problems: what is wrong with the set of files; empty unless opened with strict=False.
    """

    def __init__(
        self,
        spec: CaptureSpec,
        sources: Mapping[str, FrameSource],
        frames: tuple[int, ...],
        held_out: tuple[str, ...],
        fps: float,
        matte_source: MatteSource,
        exact_matte_source: MatteSource | None,
        warps: Mapping[str, Warp] | None,
        pool: DecoderPool,
        cache: ByteCache,
        description: str,
        problems: tuple[str, ...] = (),
    ) -> None:
        self.spec = spec
        self.camera_names = tuple(sources)
        self.held_out_cameras = held_out
        self.train_cameras = tuple(name for name in sources if name not in held_out)
        self.frames = frames
        self.fps = fps
        self.description = description
        self.problems = problems
        self._sources = dict(sources)
        self._matte_source = matte_source
        self._exact_matte_source = exact_matte_source
        self._warps = dict(warps) if warps is not None else None
        self._pool = pool
        self._cache = cache
        self._lenses = ByteCache(cache.limit // 4)  # of their own: those of a large rig would push out all pictures
        self._rig = Rig(tuple(warp.camera for warp in self._warps.values())) if self._warps is not None else None
        self._digest: str | None = None

    @property
    def rig(self) -> Rig:
        """Pinhole cameras that fit the images handed out (undistorted, scaled), named and ordered as `camera_names`.

        Raises:
            StudioError: the footage was opened without calibrated cameras.
        """
        if self._rig is None:
            raise StudioError("This footage has no calibrated cameras yet; calibrate it or give a calibration file.")
        return self._rig

    @property
    def has_evaluation_mattes(self) -> bool:
        """Whether the capture ships exact mattes."""
        return self._exact_matte_source is not None

    @property
    def matte_source(self) -> MatteSource:
        """Where the mattes come from."""
        return self._matte_source

    def raw_size(self, camera: str) -> tuple[int, int]:
        """(width, height) of the camera's frames in the files."""
        source = self._source(camera)
        return source.width, source.height

    def frames_of(self, camera: str) -> tuple[int, ...]:
        """All frames that the files of one camera have, whether others have them or not."""
        return tuple(self._source(camera).frames)

    def file_of(self, camera: str, frame: int) -> Path | None:
        """The file that a frame of a camera lies in, None where it has none."""
        files = self._source(camera).files([frame])
        return files[0] if files else None

    def raw_image(self, camera: str, frame: int) -> np.ndarray:
        """(H, W, 3) uint8 RGB as in the file: distorted, full size. For calibration.

        Raises:
            StudioError: no such camera or frame, or its file cannot be read.
        """
        return np.array(self._raw(camera, frame)[:, :, :3])

    def raw_matte(self, camera: str, frame: int) -> np.ndarray:
        """(H, W) uint8 foreground matte in the file's pixels, as `raw_image`."""
        return self._raw_matte(camera, frame).copy()

    def image(self, camera: str, frame: int) -> np.ndarray:
        """(H, W, 3) uint8 RGB, undistorted and scaled; without a colored screen's light where the masks take it off.
        The array is the caller's own.

        Raises:
            StudioError: no such camera or frame, or its file cannot be read.
        """
        return self._image(camera, frame).copy()

    def matte(self, camera: str, frame: int) -> np.ndarray:
        """(H, W) uint8, 255 foreground, undistorted and scaled like the image.

        Raises:
            StudioError: as `image`; or the mask file is missing or does not fit.
        """
        return self._matte(camera, frame, self._matte_source, "matte").copy()

    def evaluation_matte(self, camera: str, frame: int) -> np.ndarray:
        """The exact matte where the capture ships one (`spec.evaluation_mattes`), else `matte`."""
        if self._exact_matte_source is None:
            return self.matte(camera, frame)
        return self._matte(camera, frame, self._exact_matte_source, "exact").copy()

    def view(self, camera: str, frame: int) -> FootageView:
        """Camera, image and matte together; the frame is decoded once."""
        image, matte = self.image(camera, frame), self.matte(camera, frame)
        return FootageView(self.rig[camera], image, matte, frame, self.plate(camera))

    def plate(self, camera: str) -> np.ndarray | None:
        """(H, W, 3) uint8 RGB: the clean plate, undistorted and scaled like the images; None where there is none."""
        raw = self._matte_source.plate(camera) if isinstance(self._matte_source, PlateMatteSource) else None
        if raw is None:
            return None
        warp = self._warp(camera)
        if warp.is_identity:
            return raw.copy()
        key = ("plate", camera)
        kept = self._cache.get(key)
        if kept is None:
            kept = (warp.apply(raw, self._maps(camera, warp), smooth=True),)
            self._cache.put(key, *kept)
        return kept[0].copy()

    def digest(self) -> str:
        """Hexadecimal digest of the files behind the footage: names, sizes and contents (see `digest_files`)."""
        if self._digest is None:
            self._digest = digest_files(self.spec.root, self.files())
        return self._digest

    def files(self) -> list[Path]:
        """All files that images and mattes are made from."""
        paths = [path for source in self._sources.values() for path in source.files(self.frames)]
        paths += self._matte_source.files()
        if self._exact_matte_source is not None:
            paths += self._exact_matte_source.files()
        return paths

    def close(self) -> None:
        """Close all video decoders. Reading opens them again."""
        self._pool.close()

    def with_matte_source(self, matte_source: MatteSource) -> Footage:
        """The same footage with mattes from elsewhere (a matting model, say)."""
        return Footage(
            self.spec, self._sources, self.frames, self.held_out_cameras, self.fps, matte_source,
            self._exact_matte_source, self._warps, self._pool, ByteCache(self._cache.limit), self.description,
            self.problems,
        )  # fmt: skip

    def where(self, camera: str, frame: int) -> str:
        """What to call a frame in a message: its file."""
        return self._source(camera).where(frame)

    def _source(self, camera: str) -> FrameSource:
        source = self._sources.get(camera)
        if source is None:
            raise StudioError(f"There is no footage of camera '{camera}'; there is {', '.join(self.camera_names)}.")
        return source

    def _raw(self, camera: str, frame: int) -> np.ndarray:
        key = ("raw", camera, frame)
        kept = self._cache.get(key)
        if kept is not None:
            return kept[0]
        raw = self._source(camera).read(frame)
        self._cache.put(key, raw)
        return raw

    def _image(self, camera: str, frame: int) -> np.ndarray:
        warp = self._warp(camera)
        if warp.is_identity and not isinstance(self._matte_source, Recolors):
            return np.ascontiguousarray(self._raw(camera, frame)[:, :, :3])
        key = ("image", camera, frame)
        kept = self._cache.get(key)
        if kept is None:
            image = np.ascontiguousarray(self._raw(camera, frame)[:, :, :3])
            if isinstance(self._matte_source, Recolors):
                image = self._matte_source.recolored(camera, image, self._raw_matte(camera, frame))
            if not warp.is_identity:
                image = warp.apply(image, self._maps(camera, warp), smooth=True)
            kept = (image,)
            self._cache.put(key, *kept)
            self._release(camera, frame)
        return kept[0]

    def _raw_matte(self, camera: str, frame: int) -> np.ndarray:
        """Kept only where it serves both the image and the matte."""
        key = ("raw matte", camera, frame)
        kept = self._cache.get(key)
        if kept is None:
            kept = (self._matte_source.matte(camera, frame, self._raw(camera, frame)),)
            if isinstance(self._matte_source, Recolors):
                self._cache.put(key, *kept)
        return kept[0]

    def _matte(self, camera: str, frame: int, matte_source: MatteSource, kind: str) -> np.ndarray:
        key = (kind, camera, frame)
        kept = self._cache.get(key)
        if kept is None:
            warp = self._warp(camera)
            if matte_source is self._matte_source:
                raw = self._raw_matte(camera, frame)
            else:
                raw = matte_source.matte(camera, frame, self._raw(camera, frame))
            matte = raw if warp.is_identity else warp.apply(raw, self._maps(camera, warp), smooth=False)
            kept = (matte,)
            self._cache.put(key, *kept)
            self._release(camera, frame)
        return kept[0]

    def _release(self, camera: str, frame: int) -> None:
        """Forget the frame as it was decoded once all that is made of it is kept: 81 cameras at 4K would push all of
        that out."""
        exact = self._exact_matte_source is not None and camera in self.held_out_cameras
        if all(self._cache.holds((kind, camera, frame)) for kind in ("image", "matte", *(("exact",) if exact else ()))):
            for kind in ("raw", "raw matte"):
                self._cache.drop((kind, camera, frame))

    def _maps(self, camera: str, warp: Warp) -> tuple[np.ndarray, np.ndarray] | None:
        if warp.source.is_pinhole:
            return None
        kept = self._lenses.get(camera)
        if kept is None:
            kept = warp.maps()
            self._lenses.put(camera, *kept)
        return kept[0], kept[1]

    def _warp(self, camera: str) -> Warp:
        source = self._source(camera)
        if self._warps is not None:
            return self._warps[camera]
        # Without calibration the images are only scaled; any pinhole camera of the right size does.
        K = np.array([[1.0, 0, 0], [0, 1.0, 0], [0, 0, 1.0]])
        plain = Camera(camera, source.width, source.height, K, np.eye(4))
        return Warp(replace(plain), source.width, source.height, self.spec.scale)
