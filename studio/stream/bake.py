"""Baking: a group of Gaussians to its files, at a QP or at the QP that reaches a target, and the manifest over all."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from studio.errors import StudioError
from studio.gaussians import Gaussians
from studio.progress import ProgressFn, no_progress
from studio.stream.bake_motion import MotionBake
from studio.stream.bake_planes import PlanesBake
from studio.stream.manifest import MANIFEST_NAME, PROFILES, Codec, Manifest, seal
from studio.stream.manifest_models import MAX_SPLATS, GroupEntry
from studio.stream.search import QualityFn, measured_psnr, search_qp
from studio.stream.settings import BakeSettings


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
    quality: QualityFn | None = None,
    threads: int = 0,
) -> GroupEntry:
    """Bake one group into `directory/group_<nnn>/`.

    The folder appears only when it is complete and replaces one that was there; the same input gives the same bytes.
    With a target in the settings the group is baked several times, at the QPs of a bisection.

    Args:
        frames: the group's frames, keyframe first, same splats in each. The profile `planes` reads a sequence twice,
            frame by frame, so one that loads lazily keeps memory low; an iterator is held in memory.
        directory: the stream's folder; made where missing.
        group: 0-based index of the group.
        first_frame: 0-based index *in the stream* of its first frame (not the footage's frame number).
        settings: profile, QPs, targets and so on.
        progress: called with frames encoded, of all.
        threads: CPU threads; 0: one per core. Does not change the bytes.
        quality: draws a decoded frame and says how far it is from the frame as trained; needed for `target_psnr`.

    Returns:
        What the manifest says of the group.

    Raises:
        StudioError: no frames, splat counts that differ, values that are not finite, a target that no QP reaches, or
            the folder cannot be written.
    """
    if not isinstance(frames, Sequence):
        frames = list(frames)
    if not frames:
        raise StudioError(f"Baking: group {group} has no frames.")
    if len(frames[0]) > MAX_SPLATS:
        raise StudioError(f"Baking: group {group} has {len(frames[0])} splats; the format holds up to {MAX_SPLATS}.")
    prepared = (PlanesBake if settings.profile == "planes" else MotionBake)(frames, progress)

    folder = directory / group_folder_name(group)
    partial = directory / f".{folder.name}.partial"  # a fixed name: what a killed run left is replaced by the next one
    written: dict[int, GroupEntry] = {}

    def write(qp: int) -> GroupEntry:
        shutil.rmtree(partial, ignore_errors=True)
        partial.mkdir(parents=True)
        written.clear()  # one set of files is on the disk at a time
        written[qp] = prepared.write(partial, folder.name, group, first_frame, settings.at_qp(qp), progress, threads)
        return written[qp]

    def kilobytes(qp: int) -> float:
        return write(qp).bytes / len(frames) / 1000

    def psnr(qp: int) -> float:
        assert quality is not None
        entry = write(qp)
        files = {file.path: (partial / Path(file.path).name).read_bytes() for file in entry.files}
        return measured_psnr(entry, files, quality, settings.codec)

    try:
        qp = settings.qp
        if settings.target_kb_per_frame is not None:
            qp = search_qp(kilobytes, settings.target_kb_per_frame, f"group {group}", "KB a frame", at_most=True)
        elif settings.target_psnr is not None:
            if quality is None:
                raise StudioError("Baking: target_psnr needs somebody who draws the decoded frames; set qp instead.")
            qp = search_qp(psnr, settings.target_psnr, f"group {group}", "dB", at_most=False)
        entry = written.get(qp) or write(qp)
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
        StudioError: groups out of order, of different SH degree or another profile, a file that is missing or has
            another size.
    """
    path = directory / MANIFEST_NAME
    if not groups:
        raise StudioError(f"{path}: a stream needs at least one group.")
    for group in groups:
        for wanted in group.files:
            file = directory / wanted.path
            size = file.stat().st_size if file.is_file() else None
            if size != wanted.bytes:
                raise StudioError(
                    f"{file}: expected {wanted.bytes} bytes, found {'no file' if size is None else size}; "
                    f"bake group {group.index} again."
                )
    box = groups[0].bounding_box
    for group in groups[1:]:
        box = box.union(group.bounding_box)
    try:
        draft = PROFILES[settings.profile](
            codec=Codec.model_validate({"name": settings.codec}),
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


def _replace_folder(new: Path, target: Path) -> None:
    """Rename a folder into place; one that is there is moved aside first and then removed."""
    old = target.with_name(f".{target.name}.old")
    shutil.rmtree(old, ignore_errors=True)
    if target.exists():
        os.rename(target, old)
    os.rename(new, target)
    shutil.rmtree(old, ignore_errors=True)
