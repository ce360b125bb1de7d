"""Writes a job's images and masks for COLMAP."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from v3studio.studio.calibration.sfm.job import file_name
from v3studio.studio.errors import StudioError
from v3studio.studio.progress import ProgressFn

Picture = np.ndarray | Callable[[], np.ndarray]  # (H, W, 3) uint8 RGB, or a function that reads it on demand
Pictures = np.ndarray | Sequence[Picture]
"""One image of a camera, or one per sync frame; the sync frames are the same for all cameras."""


def _read_picture(picture: Any) -> np.ndarray:
    return np.asarray(picture() if callable(picture) else picture)


def _list(pictures: Any) -> list[Any]:
    return [pictures] if isinstance(pictures, np.ndarray) or callable(pictures) else list(pictures)


def write_pictures(
    folder: Path,
    names: Sequence[str],
    images: Mapping[str, Pictures],
    masks: Mapping[str, Pictures],
    progress: ProgressFn,
) -> tuple[dict[str, tuple[int, int]], int]:
    """Write PNG files to images/ and masks/; returns (width, height) per camera and the number of sync frames.

    Raises:
        StudioError: the number of images or masks differs (calibration.image_count, calibration.mask_count), sizes
            differ (calibration.image_size, calibration.mask_size), an image is not RGB (calibration.image_format), or
            a camera is masked out completely (calibration.mask_empty).
    """
    for part in ("images", "masks"):
        (folder / part).mkdir(parents=True, exist_ok=True)
    counts = {name: len(_list(images[name])) for name in names}
    sync_frames = counts[names[0]]
    for name, count in counts.items():
        if count != sync_frames:
            problem = f"camera '{name}' has {count} images, camera '{names[0]}' has {sync_frames}"
            fix = "Use the same sync frames for all cameras."
            raise StudioError(
                "calibration.image_count", problem, value=count, fix=fix, camera=name, expected=sync_frames
            )
    sizes: dict[str, tuple[int, int]] = {}
    for number, name in enumerate(names):
        own = _list(masks[name]) if name in masks else [None] * sync_frames
        if len(own) != sync_frames:
            problem = f"camera '{name}' has {len(own)} masks for {sync_frames} images"
            fix = "Provide one mask per image."
            raise StudioError(
                "calibration.mask_count", problem, value=len(own), fix=fix, camera=name, expected=sync_frames
            )
        usable = False
        for sync_frame, (picture, mask) in enumerate(zip(_list(images[name]), own, strict=True)):
            image = _read_picture(picture)
            if image.ndim != 3 or image.shape[2] != 3 or image.dtype != np.uint8:
                raise StudioError(
                    "calibration.image_format",
                    f"camera '{name}': the image is {image.dtype} of shape {image.shape}, expected uint8 (H, W, 3)",
                    value=[list(image.shape), str(image.dtype)],
                    camera=name,
                )
            size = (image.shape[1], image.shape[0])
            if sizes.setdefault(name, size) != size:
                raise StudioError(
                    "calibration.image_size",
                    f"camera '{name}': the images differ in size ({sizes[name][0]}x{sizes[name][1]} and "
                    f"{size[0]}x{size[1]})",
                    value=list(size),
                    fix="Use footage of one size per camera.",
                    camera=name,
                    expected=list(sizes[name]),
                )
            given = None if mask is None else _read_picture(mask)
            usable |= _write_picture(folder, name, file_name(number, sync_frame), image, given, bool(masks))
            done = number * sync_frames + sync_frame + 1
            progress(round(5 * done / (len(names) * sync_frames)), 100)
        if not usable:
            problem = f"camera '{name}': the masks exclude all of its images"
            fix = "Fix the masks, or set calibrate.look_at to everything."
            raise StudioError("calibration.mask_empty", problem, fix=fix, camera=name, setting="calibrate.look_at")
    return sizes, sync_frames


def _write_picture(
    folder: Path, name: str, file: str, image: np.ndarray, mask: np.ndarray | None, masked: bool
) -> bool:
    """Write one image and its mask; returns whether the mask includes any pixel."""
    if mask is None:
        mask = np.full(image.shape[:2], 255, np.uint8)
    if mask.shape != image.shape[:2]:
        problem = (
            f"camera '{name}': the mask is {mask.shape[1]}x{mask.shape[0]}, the image {image.shape[1]}x{image.shape[0]}"
        )
        value = [mask.shape[1], mask.shape[0]]
        fix = "Provide masks of the image size."
        expected = [image.shape[1], image.shape[0]]
        raise StudioError("calibration.mask_size", problem, value=value, fix=fix, camera=name, expected=expected)
    usable = mask >= (1 if mask.max() <= 1 else 128)
    fast = [cv2.IMWRITE_PNG_COMPRESSION, 1]
    files = {folder / "images" / file: image[:, :, ::-1]}
    if masked:
        files[folder / "masks" / f"{file}.png"] = usable.astype(np.uint8) * 255
    for path, pixels in files.items():
        if not cv2.imwrite(str(path), np.ascontiguousarray(pixels), fast):
            problem = "cannot be written"
            raise StudioError("calibration.unwritable", problem, file=path, fix="Check the free space and permissions.")
    return bool(usable.any())
