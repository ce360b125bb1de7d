"""Baking: a group of Gaussians to plane videos, and the manifest over all groups (paper, "Baking 3D Gaussians")."""

from __future__ import annotations

import hashlib
import math
import os
import shutil
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import repeat
from pathlib import Path
from typing import Any

import numpy as np

from studio.errors import StudioError
from studio.gaussians import Gaussians
from studio.progress import ProgressFn, no_progress
from studio.stream.layout import Component, component_frames, components, plane_side, to_plane
from studio.stream.manifest import (
    MANIFEST_NAME,
    MAX_SPLATS,
    Box,
    ComponentEntry,
    GroupEntry,
    Manifest,
    Part,
    PlaneEntry,
    seal,
)
from studio.stream.morton import morton_order
from studio.stream.quantise import quantise, split_bytes
from studio.stream.settings import BakeSettings
from studio.stream.video import PlaneEncoder


def group_folder_name(group: int) -> str:
    """Folder of a group below the stream's: group_000, group_001, ..."""
    return f"group_{group:03d}"


def bake_group(
    frames: Sequence[Gaussians] | Iterable[Gaussians],
    directory: Path,
    group: int,
    first_frame: int,
    settings: BakeSettings,
    progress: ProgressFn = no_progress,
) -> GroupEntry:
    """Bake one group into `directory/group_<nnn>/`, one MP4 a plane.

    The splats are put into Morton order of the keyframe for the whole group, each component is quantised with rounding
    over its range in the whole group, and the planes are encoded on all cores. The folder appears only when it is
    complete and replaces one that was there; the same input gives the same bytes.

    Args:
        frames: the group's frames, keyframe first, same splats in each. A sequence is read twice, frame by frame, so
            one that loads lazily keeps memory low; an iterator is held in memory.
        directory: the stream's folder; made where missing.
        group: 0-based index of the group.
        first_frame: 0-based index *in the stream* of its first frame (not the footage's frame number).
        settings: QPs, preset and so on.
        progress: called with frames encoded, of all.

    Returns:
        What the manifest says of the group.

    Raises:
        StudioError: no frames, splat counts that differ, values that are not finite, or the folder cannot be written.
    """
    if not isinstance(frames, Sequence):
        frames = list(frames)
    if not frames:
        raise StudioError(f"Baking: group {group} has no frames.")
    keyframe = frames[0]
    if len(keyframe) > MAX_SPLATS:
        raise StudioError(f"Baking: group {group} has {len(keyframe)} splats; the format holds up to {MAX_SPLATS}.")
    sh_degree = keyframe.sh_degree
    order = _keyframe_order(keyframe)
    low, high = _ranges(component_frames(_reported(frames, progress)))

    folder = directory / group_folder_name(group)
    partial = directory / f".{folder.name}.partial"  # a fixed name: what a killed run left is replaced by the next one
    try:
        shutil.rmtree(partial, ignore_errors=True)
        partial.mkdir(parents=True)
        planes = _planes(sh_degree, settings)
        box = Box(min=_point(low), max=_point(high))
        low[-7:-4] = _scale_floor(low, high)
        _encode(component_frames(frames, order), partial, planes, low, high, settings, len(frames), progress)
        entry = _entry(partial, folder.name, planes, low, high, group, first_frame, frames, box)
        _replace_folder(partial, folder)
    except OSError as error:
        raise StudioError(f"{folder}: the group cannot be written ({error.strerror or error}).") from None
    finally:
        shutil.rmtree(partial, ignore_errors=True)
    return entry


def write_manifest(
    directory: Path,
    groups: Sequence[GroupEntry],
    fps: float,
    settings: BakeSettings,
    metadata: dict[str, Any] | None = None,
) -> Manifest:
    """Write `directory/manifest.json` over baked groups, atomically.

    Args:
        directory: the stream's folder, where the groups were baked.
        groups: what `bake_group` returned, in order, covering frames 0, 1, 2, ... without a gap.
        fps: frames a second.
        settings: what the groups were baked with.
        metadata: free JSON values; nothing that changes from run to run (no dates), or the bytes will, too.
            "suggested_camera": `Camera.to_dict()` of a good first view, where there is one.

    Returns:
        The manifest, with the total bytes of all files, itself included.

    Raises:
        StudioError: groups out of order or of different SH degree, a file that is missing or has another size.
    """
    path = directory / MANIFEST_NAME
    if not groups:
        raise StudioError(f"{path}: a stream needs at least one group.")
    for group in groups:
        for plane in group.planes:
            file = directory / plane.path
            size = file.stat().st_size if file.is_file() else None
            if size != plane.bytes:
                raise StudioError(
                    f"{file}: expected {plane.bytes} bytes, found {'no file' if size is None else size}; "
                    f"bake group {group.index} again."
                )
    box = groups[0].bounding_box
    for group in groups[1:]:
        box = box.union(group.bounding_box)
    try:
        draft = Manifest(
            fps=float(fps),
            frame_count=sum(group.frame_count for group in groups),
            sh_degree=groups[0].sh_degree,
            bounding_box=box,
            groups=tuple(groups),
            settings=settings.to_dict(),
            metadata=dict(metadata or {}),
            total_bytes=1,
            manifest_sha256="0" * 64,
        )
        manifest, data = seal(draft)
    except (ValueError, TypeError) as error:
        raise StudioError(f"{path}: the manifest cannot be made ({error}).") from None
    temporary = directory / f".{MANIFEST_NAME}.partial"
    try:
        temporary.write_bytes(data)
        os.replace(temporary, path)
    except OSError as error:
        raise StudioError(f"{path}: cannot be written ({error.strerror or error}).") from None
    return manifest


def _point(values: np.ndarray) -> tuple[float, float, float]:
    return float(values[0]), float(values[1]), float(values[2])


def _keyframe_order(keyframe: Gaussians) -> np.ndarray:
    means = keyframe.means.detach().cpu().numpy()
    return morton_order(means) if np.isfinite(means).all() else np.arange(len(means))


def _reported(frames: Sequence[Gaussians], progress: ProgressFn) -> Iterator[Gaussians]:
    """The frames, giving `progress` the chance to cancel before each."""
    for frame in frames:
        progress(0, len(frames))
        yield frame


def _ranges(values: Iterator[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Minimum and maximum of each component over the group, (C,) float64."""
    low: np.ndarray | None = None
    high: np.ndarray | None = None
    for frame in values:
        frame_low, frame_high = frame.min(axis=1).astype(np.float64), frame.max(axis=1).astype(np.float64)
        low = frame_low if low is None else np.minimum(low, frame_low)
        high = frame_high if high is None else np.maximum(high, frame_high)
    assert low is not None
    assert high is not None
    return low, high


def _scale_floor(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Lower ends of the three log scales.

    Scales below the finest position step are drawn the same, yet a single splat of scale 1e-12 would take most of
    the 256 levels from all others. So the range starts at that step at the lowest.
    """
    extent = float((high[:3] - low[:3]).max())
    floor = math.log(extent / 65535) if extent > 0 else -math.inf
    return np.minimum(np.maximum(low[-7:-4], floor), high[-7:-4])


def _planes(sh_degree: int, settings: BakeSettings) -> list[tuple[int, Component, Part, int]]:
    """Row of the component, component, part and QP of each file, in the manifest's order."""
    result: list[tuple[int, Component, Part, int]] = []
    for row, component in enumerate(components(sh_degree)):
        if component.bits == 16:
            result.append((row, component, "high", settings.attribute_qp("means_high")))
            low: Part = "low_mirrored" if settings.mirror_low_bytes else "low"
            result.append((row, component, low, settings.attribute_qp("means_low")))
        else:
            result.append((row, component, "all", settings.attribute_qp(component.attribute)))
    return result


def _file_name(component: Component, part: Part) -> str:
    return f"{component.name}.mp4" if part == "all" else f"{component.name}_{part.removesuffix('_mirrored')}.mp4"


def _encode(
    values: Iterator[np.ndarray],
    folder: Path,
    planes: list[tuple[int, Component, Part, int]],
    low: np.ndarray,
    high: np.ndarray,
    settings: BakeSettings,
    frame_count: int,
    progress: ProgressFn,
) -> None:
    encoders: list[PlaneEncoder] = []

    def encode(index: int, frame: np.ndarray) -> None:
        row, component, part, _ = planes[index]
        codes = quantise(frame[row], low[row], high[row], component.levels)
        if part != "all":
            codes = split_bytes(codes, mirrored=part == "low_mirrored")[0 if part == "high" else 1]
        encoders[index].add(to_plane(codes, plane_side(frame.shape[1])))

    try:
        with ThreadPoolExecutor(settings.threads or os.cpu_count() or 1, thread_name_prefix="bake") as pool:
            for number, frame in enumerate(values):
                if not encoders:
                    side = plane_side(frame.shape[1])
                    for _, component, part, qp in planes:
                        encoders.append(PlaneEncoder(folder / _file_name(component, part), side, qp, settings.preset))
                list(pool.map(encode, range(len(planes)), repeat(frame)))
                progress(number + 1, frame_count)
            list(pool.map(PlaneEncoder.close, encoders))
    except BaseException:
        for encoder in encoders:
            encoder.abandon()
        raise


def _entry(
    partial: Path,
    folder: str,
    planes: list[tuple[int, Component, Part, int]],
    low: np.ndarray,
    high: np.ndarray,
    group: int,
    first_frame: int,
    frames: Sequence[Gaussians],
    box: Box,
) -> GroupEntry:
    entries: dict[int, list[PlaneEntry]] = {}
    total = 0
    for row, component, part, qp in planes:
        name = _file_name(component, part)
        data = (partial / name).read_bytes()
        total += len(data)
        digest = hashlib.sha256(data).hexdigest()
        plane = PlaneEntry(path=f"{folder}/{name}", part=part, qp=qp, bytes=len(data), sha256=digest)
        entries.setdefault(row, []).append(plane)
    keyframe = frames[0]
    wanted = components(keyframe.sh_degree)
    try:
        return GroupEntry(
            index=group,
            first_frame=first_frame,
            frame_count=len(frames),
            splats=len(keyframe),
            sh_degree=keyframe.sh_degree,
            side=plane_side(len(keyframe)),
            bounding_box=box,
            bytes=total,
            components=tuple(
                ComponentEntry(name=wanted[row].name, min=float(low[row]), max=float(high[row]), planes=tuple(files))
                for row, files in entries.items()
            ),
        )
    except ValueError as error:
        raise StudioError(f"Baking: group {group} does not fit the format ({error}).") from None


def _replace_folder(new: Path, target: Path) -> None:
    """Rename a folder into place; one that is there is moved aside first and then removed."""
    old = target.with_name(f".{target.name}.old")
    shutil.rmtree(old, ignore_errors=True)
    if target.exists():
        os.rename(target, old)
    os.rename(new, target)
    shutil.rmtree(old, ignore_errors=True)
