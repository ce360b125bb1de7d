"""Footage: images, masks and cameras of a capture, by camera and frame."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from v3studio.studio.cameras import Camera, FootageView, Rig
from v3studio.studio.capture.digest import digest_files
from v3studio.studio.capture.frame_sources import DecoderPool, FrameSource
from v3studio.studio.capture.settings import CaptureSettings
from v3studio.studio.chroma import ChromaSampling
from v3studio.studio.errors import Message, StudioError
from v3studio.studio.footage.sound import CaptureSound
from v3studio.studio.footage.warp import Warp
from v3studio.studio.masks.corrections import Corrections, MaskClick
from v3studio.studio.masks.mask_files import FileMaskSource
from v3studio.studio.masks.mask_source import GarbageMasks, MaskSource, Recolors, ShowsSet, masked_cameras
from v3studio.studio.masks.models import MODELS
from v3studio.studio.masks.plates import PlateMaskSource
from v3studio.studio.memory_cache import ImageCache, image_cache


@dataclass(eq=False, repr=False)
class Footage:
    """A capture's images, masks and cameras; create it with `open_footage`.

    Thread safe. Images are decoded on demand and cached up to a memory limit.

    Attributes:
        spec: the settings it was opened with.
        camera_names: all cameras, in natural order (cam2 before cam10).
        train_cameras, held_out_cameras: the cameras to train on, and those used only for evaluation.
        without_masks: other cameras of the footage, which are not used since they have no masks.
        not_chosen: other cameras of the footage, which `spec.cameras` does not name.
        frames: frame numbers as in the files, after start, stop and step.
        fps: frames per second of these frames: the footage's rate divided by step.
        notes: the files that were found and how they are read, one sentence each.
        choices: what settings choose, or should: the frame rate, cameras that are held out or not used. One sentence
            each.
        mask_source: the source of the masks.
        problems: problems with the set of files; empty unless the footage was opened with strict=False.
        sound: the sound of the footage; None without `spec.audio`.
        mask_clicks: which correct its masks, see `studio.masks.corrections`.
    """

    spec: CaptureSettings
    _sources: Mapping[str, FrameSource]
    frames: tuple[int, ...]
    held_out_cameras: tuple[str, ...]
    fps: float
    mask_source: MaskSource
    _exact_mask_source: MaskSource | None
    _warps: Mapping[str, Warp] | None
    _pool: DecoderPool
    _cache: ImageCache
    notes: tuple[str, ...]
    choices: tuple[str, ...]
    problems: tuple[Message, ...] = ()
    sound: CaptureSound | None = None
    _garbage: GarbageMasks | None = None
    without_masks: tuple[str, ...] = ()
    not_chosen: tuple[str, ...] = ()
    mask_clicks: tuple[MaskClick, ...] = ()
    _plates: PlateMaskSource | None = None  # the clean plates, for masks that do not know them

    def __post_init__(self) -> None:
        self.camera_names = tuple(self._sources)
        self.train_cameras = tuple(name for name in self._sources if name not in self.held_out_cameras)
        # A separate cache: in a shared one, the maps of a large rig would evict all images.
        self._undistortion_maps = image_cache(self._cache.limit // 4)
        self._rig = Rig(tuple(warp.camera for warp in self._warps.values())) if self._warps is not None else None
        cameras = {name: warp.source for name, warp in (self._warps or {}).items()}
        self._corrections = Corrections(
            self.mask_clicks, self.frames, self.raw_image, self._found_mask, cameras, self.train_cameras
        )
        self._digests: dict[tuple[tuple[Path, str], ...], str] = {}

    @property
    def description(self) -> str:
        """Notes and choices, one sentence per line."""
        return "\n".join((*self.notes, *self.choices))

    @property
    def filmed_fps(self) -> float | None:
        """Frames per second that the files give, whatever the step of `spec.frames`; None if they give none, as image
        sequences, or differ."""
        rates = {source.fps for source in self._sources.values() if source.fps}
        return max(rates) if rates and max(rates) <= 1.005 * min(rates) else None

    @property
    def is_calibrated(self) -> bool:
        """Whether the footage was opened with cameras, so that it has a `rig`."""
        return self._rig is not None

    @property
    def rig(self) -> Rig:
        """Pinhole cameras of the images returned by `image` (undistorted, scaled), in the order of `camera_names`.
        StudioError (`footage.not_calibrated`) if the footage was opened without a rig."""
        if self._rig is None:
            fix = "Calibrate it or provide a calibration file."
            raise StudioError("footage.not_calibrated", "The footage has no calibrated cameras", fix=fix)
        return self._rig

    @property
    def has_evaluation_masks(self) -> bool:
        """Tell whether the capture has exact masks for evaluation."""
        return self._exact_mask_source is not None

    @property
    def warnings(self) -> list[Message]:
        """Warnings on mask files that are unlikely to be right: see `FileMaskSource.warnings`."""
        sources = [self.mask_source, self._exact_mask_source]
        return [warning for each in sources if isinstance(each, FileMaskSource) for warning in each.warnings]

    @property
    def unmasked_cameras(self) -> tuple[str, ...]:
        """Held-out cameras without masks."""
        masked = masked_cameras(self.mask_source, self.held_out_cameras)
        return tuple(name for name in self.held_out_cameras if name not in masked)

    @property
    def measured_cameras(self) -> tuple[str, ...]:
        """The held-out cameras on which quality can be measured: those that have masks."""
        unmasked = self.unmasked_cameras if self._exact_mask_source is None else ()
        return tuple(name for name in self.held_out_cameras if name not in unmasked)

    def raw_size(self, camera: str) -> tuple[int, int]:
        """(width, height) of the camera's stored frames in pixels."""
        source = self._source(camera)
        return source.width, source.height

    def has_lens_distortion(self, camera: str) -> bool:
        """Return whether the stored frames have lens distortion, which `image` removes. False without calibration."""
        return not self._warp(camera).is_straight

    def frames_of(self, camera: str) -> tuple[int, ...]:
        """All frame numbers of one camera, including those that other cameras lack."""
        return tuple(self._source(camera).frames)

    def file_of(self, camera: str, frame: int) -> Path | None:
        """The file that contains a frame of a camera; None if there is none."""
        files = self._source(camera).files([frame])
        return files[0] if files else None

    def raw_image(self, camera: str, frame: int) -> np.ndarray:
        """(H, W, 3) uint8 RGB as stored: distorted, full size. For calibration. StudioError: `footage.unknown_camera`,
        `footage.no_such_frame`, or the file cannot be read."""
        return np.array(self._raw(camera, frame)[:, :, :3])

    def raw_mask(self, camera: str, frame: int) -> np.ndarray:
        """(H, W) uint8 mask of `raw_image`, 255 = foreground. Raises StudioError as `mask`."""
        return self._raw_mask(camera, frame).copy()

    def beyond_view(self, camera: str, frame: int) -> float:
        """The fraction of the performer that a camera films beyond the view of its fisheye, which `image` shows. Raises
        StudioError as `mask`."""
        warp = self._warp(camera)
        return warp.beyond(self._raw_mask(camera, frame)) if warp.source.fisheye else 0.0

    def image(self, camera: str, frame: int) -> np.ndarray:
        """(H, W, 3) uint8 RGB, undistorted, scaled, and despilled if the mask source does that (see `Recolors`). The
        caller may modify the array. StudioError as `raw_image`."""
        warp = self._warp(camera)
        if warp.is_identity and not isinstance(self.mask_source, Recolors):
            return self.raw_image(camera, frame)
        key = ("image", camera, frame)
        cached = self._cache.get(key)
        if cached is None:
            image = np.ascontiguousarray(self._raw(camera, frame)[:, :, :3])
            if isinstance(self.mask_source, Recolors):
                image = self.mask_source.recolored(camera, image, self._raw_mask(camera, frame))
            if not warp.is_identity:
                image = warp.apply(image, self._maps(camera, warp), smooth=True)
            cached = (image,)
            self._cache.put(key, cached)
            self._release(camera, frame)
        return cached[0].copy()

    def mask(self, camera: str, frame: int) -> np.ndarray:
        """(H, W) uint8, 255 = foreground, like the image. StudioError as `image`, or `mask.*` if the source fails."""
        return self._mask(camera, frame, self.mask_source, "mask").copy()

    def evaluation_mask(self, camera: str, frame: int) -> np.ndarray:
        """The exact mask if the footage was opened with such masks and this camera has them, else `mask`. Cameras on
        which nothing is measured have none."""
        exact = self._exact_mask_source
        if exact is None or (isinstance(exact, FileMaskSource) and camera not in exact.cameras):
            return self.mask(camera, frame)
        return self._mask(camera, frame, exact, "exact").copy()

    def view(self, camera: str, frame: int) -> FootageView:
        """Camera, image and mask together, decoding the frame only once; StudioError as `image`, `mask` and `rig`."""
        image, mask = self.image(camera, frame), self.mask(camera, frame)
        return FootageView(self.rig[camera], image, mask, frame, self.plate(camera))

    def full_size_view(self, camera: str, frame: int) -> FootageView:
        """A `view` at the size of the footage, whatever `spec.scale` is. Its images are not cached; a `view` of the
        same camera and frame that follows needs no more decoding."""
        scaled = self._warp(camera).source
        warp = Warp(scaled, scaled.width, scaled.height, 1.0)
        maps = self._maps(camera, warp)
        raw, mask = np.ascontiguousarray(self._raw(camera, frame)[:, :, :3]), self._raw_mask(camera, frame)
        self._cache.put(("raw mask", camera, frame), (mask,))
        if isinstance(self.mask_source, Recolors):
            raw = self.mask_source.recolored(camera, raw, mask)
        plate = self._raw_plate(camera)
        if plate is not None:
            plate = warp.apply(plate, maps, smooth=True)
        return FootageView(
            warp.camera, warp.apply(raw, maps, smooth=True), warp.apply(mask, maps, smooth=False), frame, plate
        )

    def plate(self, camera: str) -> np.ndarray | None:
        """The empty set, undistorted and scaled like the images: see `FootageView`."""
        raw = self._raw_plate(camera)
        if raw is None:
            return None
        warp = self._warp(camera)
        if warp.is_identity:
            return raw.copy()
        (plate,) = self._cache.get_or_make(
            ("plate", camera), lambda _: (warp.apply(raw, self._maps(camera, warp), smooth=True),)
        )
        return plate.copy()

    def chroma(self, camera: str, full_size: bool = False) -> ChromaSampling | None:
        """Chroma grid of a camera's images, at the size of the footage if `full_size`. None without subsampling, for
        image files, and for images that are undistorted or scaled, since these have no such grid."""
        source, warp = self._source(camera), self._warp(camera)
        return source.chroma if warp.is_identity or (full_size and warp.is_straight) else None

    def digest(self, names: Mapping[Path, str] | None = None) -> str:
        """Hexadecimal digest of `files()`: names (see `digest_files`), sizes and contents."""
        key = tuple(sorted((names or {}).items()))
        if key not in self._digests:
            models = {model.file: model.name for model in MODELS}  # which are elsewhere on other machines
            self._digests[key] = digest_files(self.spec.root, self.files(), {**models, **(names or {})})
        return self._digests[key]

    def files(self) -> list[Path]:
        """All files that images and masks depend on."""
        paths = [path for source in self._sources.values() for path in source.files(self.frames)]
        paths += self.mask_source.files()
        if self._exact_mask_source is not None:
            paths += self._exact_mask_source.files()
        if self._plates is not None:
            paths += self._plates.files()
        return paths if self._garbage is None else paths + self._garbage.files

    def close(self) -> None:
        """Close all video decoders. The next read opens them again."""
        self._pool.close()

    def _source(self, camera: str) -> FrameSource:
        source = self._sources.get(camera)
        if source is None:
            problem = f"No camera '{camera}' in the footage"
            fix = f"Cameras: {', '.join(self.camera_names)}."
            raise StudioError("footage.unknown_camera", problem, value=camera, fix=fix, known=self.camera_names)
        return source

    def _raw_plate(self, camera: str) -> np.ndarray | None:
        plate = self.mask_source.plate(camera) if isinstance(self.mask_source, ShowsSet) else None
        return self._plates.plate(camera) if plate is None and self._plates is not None else plate

    def _raw(self, camera: str, frame: int) -> np.ndarray:
        source = self._source(camera)
        return self._cache.get_or_make(("raw", camera, frame), lambda _: (source.read(frame),))[0]

    def _raw_mask(self, camera: str, frame: int) -> np.ndarray:
        """The array that `raw_mask` copies; it is cached only if the image or `beyond_view` needs it, too."""
        key = ("raw mask", camera, frame)
        cached = self._cache.get(key)
        if cached is None:
            cached = (self._corrections.corrected(camera, frame, self._found_mask(camera, frame)),)
            if isinstance(self.mask_source, Recolors) or self._warp(camera).source.fisheye:
                self._cache.put(key, cached)
        return cached[0]

    def _found_mask(self, camera: str, frame: int) -> np.ndarray:
        """The raw mask before it is corrected by hand."""
        raw = self._raw(camera, frame)
        if not masked_cameras(self.mask_source, (camera,)):
            problem = f"no masks of camera '{camera}'"
            raise StudioError("mask.missing", problem, camera=camera, frames=(frame,), kind="mask")
        mask = self.mask_source.mask(camera, frame, raw)
        inside = self._garbage.inside(camera, frame, raw) if self._garbage is not None else None
        return mask if inside is None else np.where(inside, mask, 0).astype(np.uint8)

    def _mask(self, camera: str, frame: int, mask_source: MaskSource, kind: str) -> np.ndarray:
        key = (kind, camera, frame)
        cached = self._cache.get(key)
        if cached is None:
            warp = self._warp(camera)
            if mask_source is self.mask_source:
                raw = self._raw_mask(camera, frame)
            else:
                raw = mask_source.mask(camera, frame, self._raw(camera, frame))
            mask = raw if warp.is_identity else warp.apply(raw, self._maps(camera, warp), smooth=False)
            cached = (mask,)
            self._cache.put(key, cached)
            self._release(camera, frame)
        return cached[0]

    def _release(self, camera: str, frame: int) -> None:
        """Drop the decoded frame once what derives from it is cached: frames of 81 cameras at 4K would evict that."""
        exact = self._exact_mask_source is not None and camera in self.held_out_cameras
        if all((kind, camera, frame) in self._cache for kind in ("image", "mask", *(("exact",) if exact else ()))):
            for kind in ("raw", "raw mask"):
                self._cache.drop((kind, camera, frame))

    def _maps(self, camera: str, warp: Warp) -> tuple[np.ndarray, np.ndarray] | None:
        if warp.is_straight:
            return None
        first, second = self._undistortion_maps.get_or_make(camera, lambda _: warp.maps())
        return first, second

    def _warp(self, camera: str) -> Warp:
        source = self._source(camera)
        if self._warps is not None:
            return self._warps[camera]
        # Without calibration, images are only scaled; any pinhole camera of that size will do.
        plain = Camera(camera, source.width, source.height, np.eye(3), np.eye(4))
        return Warp(plain, source.width, source.height, self.spec.scale)
