"""Baking: a group of Gaussians to files, at a given QP or at the QP that reaches a target, and the manifest."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterable, Sequence
from pathlib import Path

from pydantic import ValidationError

from studio.errors import StudioError
from studio.gaussians import Gaussians
from studio.json_types import JsonObject
from studio.progress import ProgressFn, no_progress
from studio.stream.bake_motion import MotionBake
from studio.stream.bake_planes import PlanesBake
from studio.stream.manifest import MANIFEST_NAME, PROFILES, Codec, Manifest, seal
from studio.stream.manifest_models import MAX_SPLATS, GroupEntry, invalid
from studio.stream.search import QualityFn, measured_psnr, search_qp
from studio.stream.settings import BakeSettings


def group_folder_name(group: int) -> str:
    """Name of a group's folder: group_000, group_001, ..."""
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

    The folder appears once it is complete and replaces an existing one. The same input gives the same bytes. With a
    target in the settings, the group is baked several times, at the QPs of a bisection.

    Args:
        frames: frames of the group, keyframe first, with the same splats in each. The profile `planes` reads a sequence
            twice, frame by frame, so a lazily loading one keeps memory low; an iterator is held in memory.
        directory: the stream's folder; created if missing.
        group: 0-based index of the group.
        first_frame: index *in the stream* of its first frame, 0-based (not the footage's frame number).
        settings: profile, QPs, targets and so on.
        progress: called with (frames encoded, frames).
        threads: CPU threads; 0: one per core. Does not change the bytes.
        quality: error of a decoded frame against the trained one; required for `target_psnr`.

    Returns:
        The group's entry for the manifest.

    Raises:
        StudioError: no frames, differing splat counts, values that are not finite, a target that no QP reaches, or the
            folder cannot be written.
    """
    if not isinstance(frames, Sequence):
        frames = list(frames)
    if not frames:
        raise StudioError("bake.no_frames", f"group {group} has no frames", group=group)
    if len(frames[0]) > MAX_SPLATS:
        raise StudioError(
            "bake.too_many_splats",
            f"group {group} has {len(frames[0])} splats; the format supports up to {MAX_SPLATS}",
            value=len(frames[0]),
            fix="Lower train.max_splats.",
            group=group,
            expected=MAX_SPLATS,
            setting="train.max_splats",
        )
    prepared = (PlanesBake if settings.profile == "planes" else MotionBake)(frames, progress)

    folder = directory / group_folder_name(group)
    # a fixed name, so that the next run replaces the leftovers of a killed one
    partial = directory / f".{folder.name}.partial"
    written: dict[int, GroupEntry] = {}

    def write(qp: int) -> GroupEntry:
        shutil.rmtree(partial, ignore_errors=True)
        partial.mkdir(parents=True)
        written.clear()  # only one set of files is on disk
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
            qp = search_qp(kilobytes, settings.target_kb_per_frame, f"group {group}", "KB per frame", at_most=True)
        elif settings.target_psnr is not None:
            if quality is None:
                raise StudioError(
                    "bake.no_renderer",
                    "target_psnr requires a function that renders decoded frames (quality)",
                    fix="Pass quality, or set qp instead.",
                    setting="bake.target_psnr",
                )
            qp = search_qp(psnr, settings.target_psnr, f"group {group}", "dB", at_most=False)
        entry = written.get(qp) or write(qp)
        _replace_folder(partial, folder)
    except OSError as error:
        raise StudioError(
            "bake.write_failed", f"the group cannot be written ({error.strerror or error})", file=folder, group=group
        ) from None
    finally:
        shutil.rmtree(partial, ignore_errors=True)
    return entry


def write_manifest(
    directory: Path,
    groups: Sequence[GroupEntry],
    fps: float,
    settings: BakeSettings,
    metadata: JsonObject | None = None,
) -> Manifest:
    """Write `directory/manifest.json` for baked groups, atomically.

    Args:
        directory: the stream's folder, which contains the groups.
        groups: entries from `bake_group`, in order and without gaps from frame 0.
        fps: frames per second.
        settings: as passed to `bake_group`.
        metadata: free-form JSON values. Leave out what changes between runs, such as dates, to keep the bytes
            reproducible. `StreamMetadata.to_json` makes those that players know.

    Returns:
        The manifest, including the total size of all files.

    Raises:
        StudioError: groups out of order, of another SH degree or profile, or a file is missing or has a different size.
    """
    path = directory / MANIFEST_NAME
    if not groups:
        raise StudioError("bake.no_groups", "a stream needs at least one group", file=path)
    for group in groups:
        for wanted in group.files:
            file = directory / wanted.path
            size = file.stat().st_size if file.is_file() else None
            if size != wanted.bytes:
                raise StudioError(
                    "bake.group_changed",
                    f"{'the file is missing' if size is None else f'the file has {size} bytes'}; "
                    f"expected {wanted.bytes} bytes",
                    file=file,
                    value=size,
                    fix=f"Bake group {group.index} again.",
                    group=group.index,
                    expected=wanted.bytes,
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
        raise StudioError(
            "bake.manifest_invalid", f"the manifest is invalid ({_first_line(error)})", file=path
        ) from None
    temporary = directory / f".{MANIFEST_NAME}.partial"
    try:
        temporary.write_bytes(data)
        os.replace(temporary, path)
    except OSError as error:
        raise StudioError(
            "bake.write_failed", f"the manifest cannot be written ({error.strerror or error})", file=path
        ) from None
    return manifest


def _first_line(error: Exception) -> str:
    if isinstance(error, ValidationError):
        return invalid(error, "", "").problem
    return str(error)


def _replace_folder(new: Path, target: Path) -> None:
    """Rename a folder into place. An existing one is moved aside first, then removed."""
    old = target.with_name(f".{target.name}.old")
    shutil.rmtree(old, ignore_errors=True)
    if target.exists():
        os.rename(target, old)
    os.rename(new, target)
    shutil.rmtree(old, ignore_errors=True)
