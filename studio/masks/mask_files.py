"""Masks that were made elsewhere: images or videos."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from studio.capture.detect import MASK_FOLDERS, detect_beside
from studio.capture.frame_sources import DecoderPool, FrameSource, make_sources
from studio.capture.patterns import Match, find_files, number_ranges
from studio.capture.settings import CaptureSettings
from studio.counts import plural
from studio.errors import StudioError
from studio.masks.mask_source import MaskInputs, MaskSource

_MOST_LABELS = 24  # more than any labeling of body parts, and invisible as a mask


class FileMaskSource:
    """A `MaskSource` that reads mask images, one per camera and frame, or mask videos; white is foreground.

    In a PNG file whose values are all small, they are labels: 0 is the background, any other the performer.
    If a file has an alpha channel and all its pixels have the same color, the alpha channel is used. Masks that differ
    in size from the images are resized if the aspect ratio is the same.

    Args:
        sources: camera name to its masks.
    """

    def __init__(self, sources: Mapping[str, FrameSource]) -> None:
        self._sources = dict(sources)

    def missing(self, camera: str, frames: tuple[int, ...]) -> list[int]:
        """Those of `frames` for which `camera` has no mask."""
        source = self._sources.get(camera)
        have = set(source.frames) if source is not None else set()
        return [frame for frame in frames if frame not in have]

    def mask(self, camera: str, frame: int, image: np.ndarray) -> np.ndarray:
        """See `MaskSource`.

        Raises:
            StudioError: `mask.missing`, `mask.aspect_ratio`, or the file cannot be read.
        """
        import cv2

        source = self._sources.get(camera)
        if source is None:
            raise StudioError(
                "mask.missing", f"Camera '{camera}' has no mask files", camera=camera, frames=(frame,), kind="mask"
            )
        stored = source.read(frame)
        if stored.shape[2] == 4 and np.ptp(stored[:, :, :3]) == 0:
            mask = stored[:, :, 3]
        else:
            mask = stored[:, :, :3].max(axis=2)
            # labels of body parts instead of white, as in ZJU-MoCap
            if 0 < mask.max() <= _MOST_LABELS and all(path.suffix == ".png" for path in source.files([frame])):
                mask = np.where(mask > 0, 255, 0).astype(np.uint8)
        height, width = image.shape[:2]
        if mask.shape != (height, width):
            if abs(mask.shape[1] * height - mask.shape[0] * width) > max(height, width):
                files = source.files([frame])
                raise StudioError(
                    "mask.aspect_ratio",
                    f"the mask of frame {frame} is {mask.shape[1]}x{mask.shape[0]}, its image {width}x{height}",
                    file=files[0] if files else None,
                    value=(mask.shape[1], mask.shape[0]),
                    fix="Masks must have the aspect ratio of the images.",
                    camera=camera,
                    frame=frame,
                    expected=(width, height),
                )
            shrink = mask.shape[1] > width
            how = cv2.INTER_AREA if shrink else cv2.INTER_LINEAR
            mask = cv2.resize(np.ascontiguousarray(mask), (width, height), interpolation=how)
        return np.ascontiguousarray(mask)

    def files(self) -> list[Path]:
        """See `MaskSource`."""
        return [path for source in self._sources.values() for path in source.files()]


def open_files(inputs: MaskInputs, required: bool) -> tuple[MaskSource, str] | None:
    """Masks from files: see `studio.masks.sources`. Raises StudioError `mask.not_found` or `mask.missing`."""
    found = find_files_of(
        inputs, "mask_files", MASK_FOLDERS, required,
        code="mask.not_found", what="mask", example="masks/{camera}/{frame}.png",
    )  # fmt: skip
    if found is None:
        return None
    pattern, matches = found
    source = _file_mask_source(matches, inputs.names, inputs.frames, inputs.pool, "mask", inputs.spec.offsets)
    return source, f"files '{pattern}'"


def find_files_of(
    inputs: MaskInputs, setting: str, folders: Sequence[str], required: bool, *, code: str, what: str, example: str
) -> tuple[str, list[Match]] | None:
    """The pattern and the files that a setting names; if it is auto, those in one of the usual `folders`, or None.

    Raises:
        StudioError: `code`: there are none, but the setting names some, or they are `required`.
    """
    root, wanted = inputs.spec.root, getattr(inputs.spec, setting)
    if wanted != "auto":
        matches = [match for match in find_files(root, wanted) if match.camera in inputs.sources]
        if not matches:
            raise StudioError(
                code,
                f"no {what} of the footage's cameras matches the pattern '{wanted}'",
                file=root,
                value=wanted,
                fix=f"Check capture.{setting}.",
                setting=f"capture.{setting}",
            )
        return wanted, matches
    found = find_beside(root, folders, inputs.sources)
    if found is None and required:
        raise StudioError(
            code,
            f"no {what}s found" if what != "mask" else "no mask files found",
            file=root,
            fix=f"Set capture.{setting}, for example '{example}'.",
            setting=f"capture.{setting}",
        )
    return found


def find_beside(
    root: Path, folders: Sequence[str], sources: Mapping[str, FrameSource]
) -> tuple[str, list[Match]] | None:
    """Masks or clean plates below `root`, or else in the folder of `root` that has all the footage."""
    found = detect_beside(root, folders, tuple(sources))
    if found is not None:
        return found
    files = [path for source in sources.values() for path in source.files()]
    within = [path.relative_to(root).parts for path in files if path.is_relative_to(root)]
    first = {parts[0] for parts in within if len(parts) > 1}
    if len(within) < len(files) or len(first) != 1:
        return None
    folder = first.pop()
    found = detect_beside(root / folder, folders, tuple(sources))
    return (f"{folder}/{found[0]}", found[1]) if found is not None else None


def _file_mask_source(
    matches: list[Match],
    names: tuple[str, ...],
    frames: tuple[int, ...],
    pool: DecoderPool,
    what: str,
    offsets: Mapping[str, int],
) -> FileMaskSource:
    mask_source = FileMaskSource(make_sources(matches, pool, offsets=offsets, transfer="srgb"))
    for name in names:
        missing = mask_source.missing(name, frames)
        if missing:
            raise StudioError(
                "mask.missing",
                f"Camera '{name}' has no {what} for {plural('frame', len(missing))} {number_ranges(missing)}",
                fix="Add the missing files, or exclude the camera or the frames.",
                camera=name,
                frames=tuple(missing),
                kind=what,
            )
    return mask_source


def exact_masks(
    spec: CaptureSettings, names: tuple[str, ...], frames: tuple[int, ...]
) -> tuple[MaskSource | None, str]:
    """The exact masks for evaluation, `spec.evaluation_masks`.

    Args:
        spec: the capture's settings.
        names: cameras of the footage.
        frames: frame numbers that must have a mask.

    Returns:
        their source and a sentence that describes it; None and "" if the setting is empty.

    Raises:
        StudioError: `mask.not_found`, or `mask.missing` for a camera or frame.
    """
    pattern = spec.evaluation_masks
    if not pattern:
        return None, ""
    matches = [match for match in find_files(spec.root, pattern) if match.camera in names]
    if not matches:
        raise StudioError(
            "mask.not_found",
            f"no evaluation mask matches the pattern '{pattern}'",
            file=spec.root,
            value=pattern,
            fix="Check capture.evaluation_masks.",
            setting="capture.evaluation_masks",
        )
    mask_source = _file_mask_source(matches, names, frames, DecoderPool(len(names)), "evaluation mask", spec.offsets)
    return mask_source, f"Evaluation within the exact masks '{pattern}'."
