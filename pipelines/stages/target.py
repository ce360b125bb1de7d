"""Calibration from footage of a calibration target, for the stage `calibrate`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import closing
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from v3studio.pipelines.stages.reporter import StageReporter
from v3studio.studio.calibration.settings import CalibrateSettings
from v3studio.studio.errors import Message, StudioError
from v3studio.studio.progress import ProgressFn
from v3studio.studio.validation import camera_error

_MOST_FRAMES = 300  # per camera that are searched for the target, spread evenly: more views do not help

if TYPE_CHECKING:
    from v3studio.studio.calibration import CalibrationResult, TargetObservation
    from v3studio.studio.calibration.report import IntrinsicsReport
    from v3studio.studio.cameras import Camera
    from v3studio.studio.capture import CaptureSettings
    from v3studio.studio.footage import Footage


def target_digest(settings: CalibrateSettings, capture: CaptureSettings) -> list[str]:
    """Digests of the files with the calibration target."""
    patterns = (settings.board_images, settings.intrinsics_images)
    return [_open(capture.replace(offsets={}), pattern).digest() for pattern in patterns if pattern]


def calibrate_with_target(
    settings: CalibrateSettings, capture: CaptureSettings, names: Sequence[str], threads: int, reporter: StageReporter
) -> CalibrationResult:
    """Calibrate these cameras from `board_images`, and `intrinsics_images` too. Raises StudioError: `target.*`."""
    from v3studio.studio.calibration import calibrate_from_target

    assert settings.board_images is not None
    detecting = reporter.part("detecting the target", 0.0, 0.6 if settings.intrinsics_images else 0.8)
    views, sizes = _views(settings, capture, settings.board_images, names, detecting)
    if settings.intrinsics_images:
        detecting = reporter.part("detecting the target", 0.6, 0.8)
        unshifted = capture.replace(offsets={})  # each camera's own images, which need not be synchronized
        own, own_sizes = _views(settings, unshifted, settings.intrinsics_images, names, detecting)
        for name, size in own_sizes.items():
            if sizes[name] != size:
                problem = (
                    f"calibrate.intrinsics_images is {size[0]}x{size[1]}, but calibrate.board_images "
                    f"is {sizes[name][0]}x{sizes[name][1]}"
                )
                fix = "Record both at the same size."
                raise camera_error("target.size_mismatch", name, problem, value=size, fix=fix, expected=sizes[name])
        # separate sync frames, not shared with other cameras
        alone = min([sync_frame for sync_frame, _ in views] or [0]) - 1
        for number, ((_, name), view) in enumerate(own.items()):
            views[alone - number, name] = view
    solving = reporter.part("solving", 0.8, 1.0)
    result = calibrate_from_target(settings.board, views, sizes, settings=settings, threads=threads, progress=solving)
    target = result.report.target
    assert target is not None
    left_out, used = target.views_left_out, target.views
    if left_out > 0.2 * (left_out + used):
        problem = (
            f"rejected {left_out} of {left_out + used} views: their target pose disagrees with other cameras in "
            "the same frame"
        )
        fix = "Check that the cameras are synchronized and that the target was moved slowly."
        reporter.warn(
            Message("target.outlier_views", problem, value=left_out, fix=fix, fields={"views": left_out + used})
        )
    return result


def intrinsics_from_target(
    settings: CalibrateSettings, capture: CaptureSettings, names: Sequence[str], threads: int, detecting: ProgressFn
) -> tuple[dict[str, Camera], dict[str, IntrinsicsReport]]:
    """These cameras by name from `intrinsics_images`, and a report of their reprojection errors."""
    from v3studio.studio.calibration import calibrate_intrinsics

    assert settings.intrinsics_images is not None
    unshifted = capture.replace(offsets={})
    views, sizes = _views(settings, unshifted, settings.intrinsics_images, names, detecting)
    own = {name: [view for (_, camera), view in views.items() if camera == name] for name in sizes}
    return calibrate_intrinsics(own, sizes, settings, threads)


def _open(capture: CaptureSettings, pattern: str) -> Footage:
    from v3studio.studio.capture import CaptureSettings
    from v3studio.studio.footage import open_footage

    spec = CaptureSettings(
        root=capture.root,
        images=pattern,
        masks="none",
        cameras=capture.cameras,
        color_matrix=capture.color_matrix,
        offsets=capture.offsets,
        fps=1.0,
    )
    return open_footage(spec, None, strict=False)


def _views(
    settings: CalibrateSettings, capture: CaptureSettings, pattern: str, names: Sequence[str], detecting: ProgressFn
) -> tuple[dict[tuple[int, str], TargetObservation], dict[str, tuple[int, int]]]:
    """Views of the target by sync frame and camera, and the cameras' image sizes."""
    from v3studio.studio.calibration import detect_target

    footage = _open(capture, pattern)
    missing = [name for name in names if name not in footage.camera_names]
    if missing:
        problem = (
            f"the pattern '{pattern}' matches no images of camera '{missing[0]}' (found: "
            f"{', '.join(footage.camera_names)})"
        )
        fix = "Every camera of the footage needs images of the calibration target, under the same camera name."
        raise StudioError(
            "target.no_footage", problem, value=pattern, fix=fix, camera=missing[0], found=list(footage.camera_names)
        )
    # the same frames for all cameras
    frames = sorted({frame for name in names for frame in footage.frames_of(name)})
    chosen = {frames[int(index)] for index in np.linspace(0, len(frames) - 1, min(_MOST_FRAMES, len(frames)))}
    sync_frames = {name: [frame for frame in footage.frames_of(name) if frame in chosen] for name in names}
    readers: dict[str, Callable[[int], np.ndarray]] = {name: partial(footage.raw_image, name) for name in names}
    with closing(footage):
        return detect_target(readers, sync_frames, settings.board, detecting)
