"""From settings to the plain arguments that functions of `studio` take; the only place where this happens."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipelines.config import (
    BakeSection,
    BoardSection,
    CalibrateSection,
    CaptureSection,
    InitializeSection,
    RunSection,
    TrainSection,
)
from studio.errors import StudioError

if TYPE_CHECKING:
    from studio.calibration import CalibrationTarget, SfmSettings, TargetSettings, TieSettings
    from studio.capture import CaptureSpec
    from studio.meshing import HullSettings
    from studio.stream import BakeSettings
    from studio.training import TrainSettings

NOT_TRAINING = ("group_size", "grouping", "group_change", "check_footage", "checkpoint_every")
"""Settings of the train section that say nothing of how one frame is trained."""

_RIG_FOLDERS = (
    ".", "calibration", "cameras", "sparse/0", "sparse", "colmap/sparse/0", "sparse_full_resolution", "image_white",
)  # fmt: skip


def capture_spec(section: CaptureSection, run: RunSection | None = None) -> CaptureSpec:
    """What `studio.capture` is told of the footage; `run` says what matting models are run on (None: the defaults)."""
    from studio.capture import CaptureSpec

    run = run or RunSection()
    values = section.model_dump(exclude={"rig", "cache_megabytes"})
    cache = None if section.cache_megabytes is None else section.cache_megabytes * 2**20
    return CaptureSpec(**values, cache_bytes=cache, mask_device=run.device, mask_threads=run.threads)


def sfm_settings(section: CalibrateSection, run: RunSection) -> SfmSettings:
    """How structure from motion solves."""
    from studio.calibration import SfmSettings

    names = {field.name for field in fields(SfmSettings)}
    return SfmSettings(**section.model_dump(include=names), threads=run.threads, seed=run.seed)


def board(section: BoardSection) -> CalibrationTarget:
    """The board of the settings."""
    from studio.calibration import CalibrationTarget

    return CalibrationTarget(**section.model_dump())


def board_settings(section: CalibrateSection, run: RunSection) -> TargetSettings:
    """How cameras are found from a board."""
    from studio.calibration import TargetSettings

    return TargetSettings(
        camera_model=section.camera_model,
        principal_point="refine" if section.refine_principal_point else "auto",
        origin=section.board_origin,
        upright=section.board_upright,
        threads=run.threads,
    )


def tie_settings(section: CalibrateSection, run: RunSection) -> TieSettings:
    """How cameras are found from points marked by hand."""
    from studio.calibration import Accuracy, TieSettings

    return TieSettings(
        accuracy=Accuracy(mark=section.tie_accuracy, world=section.tie_world_accuracy),
        shared_intrinsics=section.shared_intrinsics,
        radial=section.camera_model not in ("SIMPLE_PINHOLE", "PINHOLE"),
        seed=run.seed,
    )


def hull_settings(section: InitializeSection) -> HullSettings:
    """How the hull is carved."""
    from studio.meshing import HullSettings

    return HullSettings(**section.model_dump(include={field.name for field in fields(HullSettings)}))


def train_settings(section: TrainSection) -> TrainSettings:
    """How frames are trained."""
    from studio.training import LearningRates, TrainSettings

    values: dict[str, Any] = section.model_dump(
        exclude={"rates", "group_size", "grouping", "group_change", "check_footage"}
    )
    return TrainSettings(**values, rates=LearningRates(**section.rates.model_dump()))


def bake_settings(section: BakeSection, threads: int) -> BakeSettings:
    """How frames become video."""
    from studio.stream import BakeSettings

    return BakeSettings(**section.model_dump(), threads=threads)


def camera_file(section: CaptureSection) -> Path | None:
    """The capture's calibration, or None where the cameras must be found from the footage.

    Raises:
        StudioError: the named file is not there, or several usual ones are.
    """
    if section.rig is None:
        return None
    if section.rig != "auto":
        path = section.root / section.rig
        if not path.exists():
            raise StudioError(
                f"{path}: there is no such file; set capture.rig to the calibration, or to null to calibrate from the "
                "footage."
            )
        return path
    from studio.camera_files import find_camera_files

    found: list[Path] = []
    for folder in (section.root / name for name in _RIG_FOLDERS):
        found += find_camera_files(folder) if folder.is_dir() else []
    if not found:  # VideoGS: a folder a frame with its own transforms.json, the same in all
        frames = [part for part in section.root.glob("*/transforms.json") if part.parent.name.isdecimal()]
        found = sorted(frames, key=lambda part: int(part.parent.name))[:1]
    if len(found) > 1:
        names = ", ".join(str(path.relative_to(section.root)) for path in found)
        raise StudioError(f"{section.root} has several calibrations ({names}); name one in capture.rig.")
    return found[0] if found else None


def choose_device(name: str) -> str:
    """A torch device that is there.

    Raises:
        StudioError: a GPU was asked for that torch cannot see.
    """
    import torch

    from studio.rasterizer import available_backends

    if name == "auto":
        return "cuda" if "cuda" in available_backends() else "cpu"
    if name.startswith("cuda"):
        if not torch.cuda.is_available():
            raise StudioError(f"run.device = {name}, but torch sees no GPU; set run.device to cpu or auto.")
        index = int(name.partition(":")[2] or 0)
        if index >= torch.cuda.device_count():
            raise StudioError(f"run.device = {name}, but there are {torch.cuda.device_count()} GPUs, counted from 0.")
    return name
