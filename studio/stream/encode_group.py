"""Encodes one group at one QP, at the QP that reaches a target, or with a limit to what each frame loses."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path

from studio.errors import StudioError
from studio.gaussians import Gaussians
from studio.progress import ProgressFn
from studio.stream.bake_motion import MotionBake
from studio.stream.bake_planes import PlanesBake
from studio.stream.frame_losses import FilmedErrorFn, filmed_errors, limited_offsets
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
    error: FilmedErrorFn | None = None,
) -> GroupEntry:
    """Write the files of a group into the folder `partial`, which is replaced. Arguments as for `bake.bake_group`.

    Returns:
        The group's entry, with paths in the folder `name`.

    Raises:
        StudioError: values that are not finite, a target that no QP reaches, or a target or limit without the function
            that measures it.
        OSError: the files cannot be written.
    """
    written: dict[int, GroupEntry] = {}

    def write(qp: int, offsets: Sequence[int] = ()) -> GroupEntry:
        shutil.rmtree(partial, ignore_errors=True)
        partial.mkdir(parents=True)
        written.clear()  # only one set of files is on disk
        own = settings.at_qp(qp)
        written[qp] = prepared.write(partial, name, group, first_frame, own, progress, threads, fps, offsets)
        return written[qp]

    def kilobytes(qp: int) -> float:
        return write(qp).bytes / frame_count / 1000

    def psnr(qp: int) -> float:
        assert quality is not None
        return measured_psnr(entry := write(qp), contents(entry, partial), quality, settings.codec)

    def filmed(offsets: Sequence[int]) -> list[tuple[float, float]]:
        assert error is not None
        return filmed_errors(entry := write(settings.qp, offsets), contents(entry, partial), error, settings.codec)

    qp = settings.qp
    if settings.max_loss is not None and qp > 0:
        if error is None:
            raise StudioError(
                "bake.no_footage",
                "max_loss requires a function that compares decoded frames with the footage (error)",
                fix="Bake a take, pass error, or set max_loss to null.",
                setting="bake.max_loss",
            )
        limited_offsets(filmed, frame_count, qp, settings.max_loss)
    elif settings.target_kb_per_frame is not None:
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
