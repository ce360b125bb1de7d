"""Baking: a group of Gaussians to files, at a given QP or at the QP that reaches a target, and the manifest."""

from __future__ import annotations

import contextlib
import errno
import os
import shutil
from collections.abc import Iterable, Sequence
from pathlib import Path

from studio.atomic_files import leftovers, remove, remove_leftovers, temporary_path
from studio.errors import StudioError
from studio.gaussians import Gaussians
from studio.json_types import JsonObject
from studio.progress import ProgressFn, no_progress
from studio.stream.bake_ladder import ContributionFn, FinetunedFn, bake_ladder
from studio.stream.encode_group import encode_group, prepare
from studio.stream.frame_losses import FilmedErrorFn
from studio.stream.ladder_models import AudioEntry, BakedGroup, GroupLadder
from studio.stream.manifest import MANIFEST_NAME, PROFILES, Codec, Manifest, seal
from studio.stream.manifest_models import MAX_SPLATS, FileEntry, GroupEntry
from studio.stream.search import QualityFn
from studio.stream.settings import BakeSettings
from studio.stream.write_ladder import first_finding, replace_manifest, write_ladder


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
    fps: float | None = None,
    contribution: ContributionFn | None = None,
    finetuned: FinetunedFn | None = None,
    error: FilmedErrorFn | None = None,
) -> BakedGroup:
    """Bake one group: into `directory/group_<nnn>/` for version 2, into files named by their content for version 3.

    The folder appears once it is complete and replaces an existing one. The same input gives the same bytes. With a
    target in the settings, the group is baked several times, at the QPs of a bisection; with a ladder, once per rung.

    Args:
        frames: frames of the group, keyframe first, with the same splats in each. The profile `planes` reads a sequence
            twice, frame by frame, so a lazily loading one keeps memory low; an iterator is held in memory.
        directory: the stream's folder; created if missing.
        group: 0-based index of the group.
        first_frame: index *in the stream* of its first frame, 0-based (not the footage's frame number).
        settings: profile, QPs, targets and so on.
        progress: called with (frames encoded, frames).
        threads: CPU threads; 0: one per core. Does not change the bytes.
        quality: error of a decoded frame against the trained one; required for `target_psnr`. In version 3, the
            renditions' `psnr_to_trained` is measured with it.
        fps: version 3: frames per second of the stream, which the level of its videos is chosen for; None: 30.
        contribution: what each splat adds to the pictures; required for rungs that keep fewer splats as they are.
        finetuned: frames of rungs that keep fewer splats and are trained further; required for these.
        error: errors of a decoded and of the trained frame against the footage; required for `max_loss`.

    Returns:
        The group's entry for the manifest.

    Raises:
        StudioError: no frames, differing splat counts, values that are not finite, a target that no QP reaches, no
            `contribution`, `finetuned` or `error` where it is needed, or the folder cannot be written.
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
    folder = directory / group_folder_name(group)
    partial = temporary_path(folder)
    try:
        for name in ("partial", "old"):  # of a killed run of earlier versions
            shutil.rmtree(directory / f".{folder.name}.{name}", ignore_errors=True)
        remove_leftovers(directory, folder)
        if settings.stream_version == 3:
            return bake_ladder(
                frames,
                directory,
                partial,
                group,
                first_frame,
                settings,
                progress,
                quality,
                threads,
                fps,
                contribution,
                finetuned,
                error,
            )
        prepared = prepare(frames, settings, progress)
        entry = encode_group(
            prepared,
            partial,
            folder.name,
            group,
            first_frame,
            len(frames),
            settings,
            progress,
            quality,
            threads,
            error=error,
        )
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
    groups: Sequence[BakedGroup],
    fps: float,
    settings: BakeSettings,
    metadata: JsonObject | None = None,
    live: bool = False,
    audio: AudioEntry | None = None,
) -> Manifest:
    """Write `directory/manifest.json` for baked groups, atomically.

    In version 3, files that the new manifest does not need are removed after it has replaced the old one.

    Args:
        directory: the stream's folder, which contains the groups.
        groups: entries from `bake_group`, in order and without gaps from frame 0.
        fps: frames per second.
        settings: as passed to `bake_group`.
        metadata: free-form JSON values. Leave out what changes between runs, such as dates, to keep the bytes
            reproducible. `StreamMetadata.to_json` makes those that players know.
        live: version 3: further groups will follow.
        audio: version 3: the sound, from `bake_sound`; no longer than the frames.

    Returns:
        The manifest, including the total size of all files; in version 3, of the best rendition.

    Raises:
        StudioError: groups out of order, of another SH degree or profile, or a file is missing or has a different size,
            or sound for version 2 (`bake.no_sound_in_version_2`).
    """
    path = directory / MANIFEST_NAME
    if not groups:
        raise StudioError("bake.no_groups", "a stream needs at least one group", file=path)
    _check_present(directory, groups, audio)
    ladders = [group for group in groups if isinstance(group, GroupLadder)]
    if ladders:
        if len(ladders) < len(groups):
            raise StudioError("bake.manifest_invalid", "groups of versions 2 and 3 are mixed", file=path)
        return write_ladder(directory, ladders, float(fps), settings, dict(metadata or {}), live, audio)
    if audio is not None:
        raise StudioError(
            "bake.no_sound_in_version_2",
            "streams of version 2 have no sound",
            file=path,
            fix="Set bake.stream_version to 3.",
            setting="bake.stream_version",
        )
    return _write_plain(path, [group for group in groups if isinstance(group, GroupEntry)], fps, settings, metadata)


def _check_present(directory: Path, groups: Sequence[BakedGroup], audio: AudioEntry | None) -> None:
    files: list[tuple[FileEntry, int | None]] = [(file, group.index) for group in groups for file in group.files]
    files += [(audio, None)] if audio is not None else []
    for wanted, group in files:
        file = directory / wanted.path
        size = file.stat().st_size if file.is_file() else None
        if size != wanted.bytes:
            raise StudioError(
                "bake.group_changed",
                f"{'the file is missing' if size is None else f'the file has {size} bytes'}; "
                f"expected {wanted.bytes} bytes",
                file=file,
                value=size,
                fix="Bake the sound again." if group is None else f"Bake group {group} again.",
                group=group,
                expected=wanted.bytes,
            )


def _write_plain(
    path: Path, groups: Sequence[GroupEntry], fps: float, settings: BakeSettings, metadata: JsonObject | None
) -> Manifest:
    """The manifest of version 2."""
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
            "bake.manifest_invalid", f"the manifest is invalid ({first_finding(error)})", file=path
        ) from None
    replace_manifest(path, data, [file.path for group in groups for file in group.files])
    return manifest


def _replace_folder(new: Path, target: Path) -> None:
    """Rename a folder into place. An existing one is moved aside first, then removed.

    Where several workers do it at once, the folder of one of them remains, whole.
    """
    for path in leftovers(target.parent, target, ".old"):
        remove(path)
    while True:
        try:
            os.rename(new, target)
            return
        except OSError as error:
            if error.errno not in (errno.ENOTEMPTY, errno.EEXIST):
                raise
        old = temporary_path(target, ".old")
        with contextlib.suppress(FileNotFoundError):  # another worker has just moved it
            os.rename(target, old)
        remove(old)
