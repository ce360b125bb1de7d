"""The pictures of a job, written as COLMAP reads them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from studio.calibration.sfm.features import file_name
from studio.errors import StudioError
from studio.progress import ProgressFn

Picture = np.ndarray | Callable[[], np.ndarray]
"""(H, W, 3) uint8 RGB, or what reads it when it is needed."""
Pictures = np.ndarray | Sequence[Picture]
"""A camera's picture, or its pictures of several moments, the same moments for all cameras."""


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
    """PNG files for COLMAP in images/ and masks/; (width, height) of each camera's, and how many moments there are.

    Args:
        folder: the work folder.
        names: the cameras, in their order.
        images, masks: see `calibrate_from_images`.
        progress: told up to 5 of 100.

    Raises:
        StudioError: pictures that cannot be used, named.
    """
    for part in ("images", "masks"):
        (folder / part).mkdir(parents=True, exist_ok=True)
    counts = {name: len(_list(images[name])) for name in names}
    sync_frames = counts[names[0]]
    for name, count in counts.items():
        if count != sync_frames:
            raise StudioError(f"Camera '{name}' has pictures of {count} moments, '{names[0]}' of {sync_frames}.")
    sizes: dict[str, tuple[int, int]] = {}
    for number, name in enumerate(names):
        own = _list(masks[name]) if name in masks else [None] * sync_frames
        if len(own) != sync_frames:
            raise StudioError(
                f"Camera '{name}' has {len(own)} masks for {sync_frames} pictures; give a mask a picture."
            )
        usable = False
        for sync_frame, (picture, mask) in enumerate(zip(_list(images[name]), own, strict=True)):
            image = _read_picture(picture)
            if image.ndim != 3 or image.shape[2] != 3 or image.dtype != np.uint8:
                raise StudioError(
                    f"Camera '{name}': the image must be (H, W, 3) uint8, found {image.shape} {image.dtype}."
                )
            size = (image.shape[1], image.shape[0])
            if sizes.setdefault(name, size) != size:
                raise StudioError(f"Camera '{name}': its pictures differ in size ({sizes[name]} and {size}).")
            given = None if mask is None else _read_picture(mask)
            usable |= _write_picture(folder, name, file_name(number, sync_frame), image, given, bool(masks))
            done = number * sync_frames + sync_frame + 1
            progress(round(5 * done / (len(names) * sync_frames)), 100)
        if not usable:
            raise StudioError(f"Camera '{name}': the mask leaves nothing of the image to find features in; mend it.")
    return sizes, sync_frames


def _write_picture(
    folder: Path, name: str, file: str, image: np.ndarray, mask: np.ndarray | None, masked: bool
) -> bool:
    """One picture and its mask; whether the mask leaves anything."""
    import cv2

    if mask is None:
        mask = np.full(image.shape[:2], 255, np.uint8)
    if mask.shape != image.shape[:2]:
        raise StudioError(
            f"Camera '{name}': the mask is {mask.shape[1]}x{mask.shape[0]}, the image "
            f"{image.shape[1]}x{image.shape[0]}; give masks of the image's size."
        )
    usable = mask >= (1 if mask.max() <= 1 else 128)
    fast = [cv2.IMWRITE_PNG_COMPRESSION, 1]
    files = {folder / "images" / file: image[:, :, ::-1]}
    if masked:
        files[folder / "masks" / f"{file}.png"] = usable.astype(np.uint8) * 255
    for path, pixels in files.items():
        if not cv2.imwrite(str(path), np.ascontiguousarray(pixels), fast):
            raise StudioError(f"{path}: cannot be written; check the disk and the permissions.")
    return bool(usable.any())
