"""Encodes one group at one QP, or at the QP that reaches a target."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path

from studio.errors import StudioError
from studio.gaussians import Gaussians
from studio.progress import ProgressFn
from studio.stream.bake_motion import MotionBake
from studio.stream.bake_planes import PlanesBake
from studio.stream.manifest_models import GroupEntry
from studio.stream.search import QualityFn, measured_psnr, search_qp
from studio.stream.settings import BakeSettings


def prepare(frames: Sequence[Gaussians], settings: BakeSettings, progress: ProgressFn) -> MotionBake | PlanesBake:
    """What does not depend on the QP, done once."""
    return (PlanesBake if settings.profile == "planes" else MotionBake)(frames, progress)


def encode_group(
    prepared: MotionBake | PlanesBake,
    partial: Path,
    name: str,
    group: int,
    first_frame: int,
    frame_count: int,
    settings: BakeSettings,
    progress: ProgressFn,
    quality: QualityFn | None,
    threads: int,
    fps: float | None = None,
) -> GroupEntry:
    """Write the files of a group into the folder `partial`, which is replaced. Arguments as for `bake.bake_group`.

    Returns:
        The group's entry, with paths in the folder `name`.

    Raises:
        StudioError: values that are not finite, or a target that no QP reaches.
        OSError: the files cannot be written.
    """
    written: dict[int, GroupEntry] = {}

    def write(qp: int) -> GroupEntry:
        shutil.rmtree(partial, ignore_errors=True)
        partial.mkdir(parents=True)
        written.clear()  # only one set of files is on disk
        written[qp] = prepared.write(partial, name, group, first_frame, settings.at_qp(qp), progress, threads, fps)
        return written[qp]

    def kilobytes(qp: int) -> float:
        return write(qp).bytes / frame_count / 1000

    def psnr(qp: int) -> float:
        assert quality is not None
        return measured_psnr(entry := write(qp), contents(entry, partial), quality, settings.codec)

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
    return written.get(qp) or write(qp)


def contents(entry: GroupEntry, folder: Path) -> dict[str, bytes]:
    """Content by path of the files of a group, which are in `folder`."""
    return {file.path: (folder / Path(file.path).name).read_bytes() for file in entry.files}
