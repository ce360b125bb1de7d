"""The cameras of a take, refined once before its groups are trained."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from v3studio.pipelines.reports.calibration import write_calibration_page
from v3studio.pipelines.stages.params import derived_seed
from v3studio.pipelines.stages.reporter import StageReporter
from v3studio.pipelines.stages.training.camera_fit import check_first_points, ensure_fitted, initial_points
from v3studio.pipelines.stages.training.plan import TrainPlan
from v3studio.pipelines.stages.training.views import ViewReader
from v3studio.pipelines.takes.files.json_files import write_model
from v3studio.pipelines.takes.results.stage_files import CameraChange, CameraRefinement
from v3studio.studio.atomic_files import atomic_path, remove
from v3studio.studio.camera_files import read_rig, write_rig
from v3studio.studio.cameras import Camera, Rig
from v3studio.studio.own_frame import own_frame

if TYPE_CHECKING:
    from v3studio.studio.training import Correction, TrainingView


def ensure_refined_cameras(plan: TrainPlan, reporter: StageReporter, key: str) -> None:
    """Refine the cameras unless that is done; any worker gives the same bytes. Raises StudioError."""
    check_first_points(plan.take, "the cameras are refined with")
    fit = partial(_refine, plan, reporter, key)
    ensure_fitted(plan, reporter, plan.take.camera_refinement, CameraRefinement, key, fit)
    plan.inputs.forget_cameras()


def drop_refined_cameras(plan: TrainPlan) -> None:
    """Delete what refining the cameras gave."""
    for path in (plan.take.camera_refinement, plan.take.refined_rig):
        if path.exists():
            plan.take.forget("train")
            remove(path)
            plan.inputs.forget_cameras()


def _refine(plan: TrainPlan, reporter: StageReporter, key: str) -> None:
    from v3studio.studio.training import refine_cameras
    from v3studio.studio.training.camera_refinement import WORTH

    take, group, reader = plan.take, plan.groups[0], ViewReader.of(plan.inputs, before_fits=True)
    footage = reader.footage
    reading, refining = reporter.counting("refining cameras: image"), reporter.counting("refining cameras: step")

    def views(cameras: Sequence[str]) -> list[TrainingView]:
        seeing = [name for name in cameras if (footage.view(name, group.keyframe).mask > 127).any()]
        if not seeing:
            return []
        return reader.views(group.keyframe, reporter, reading, plan.inputs.threads, seeing)

    trained, held_out = views(footage.train_cameras), views(footage.measured_cameras)
    points, seed = initial_points(take, group, reader.device), derived_seed(plan.seed, "camera refinement")
    fitted = refine_cameras(trained, *points, plan.settings, held_out=held_out, seed=seed, progress=refining)
    used = fitted.gain >= WORTH
    names = [view.camera.name for view in (*trained, *held_out)]
    corrections = dict(zip(names, (*fitted.corrections, *fitted.held_out), strict=True))
    given = read_rig(take.rig)
    rig = _refined(given, footage.rig, corrections)
    drop_refined_cameras(plan)
    if used:
        with atomic_path(take.refined_rig) as temporary:
            write_rig(rig, temporary)
    report = CameraRefinement(
        key=key,
        frame=int(group.keyframe),
        used=used,
        before=round(fitted.before, 3),
        after=round(fitted.after, 3),
        held_out_calibrated=fitted.held_out_calibrated and round(fitted.held_out_calibrated, 3),
        held_out_before=fitted.held_out_before and round(fitted.held_out_before, 3),
        held_out_after=fitted.held_out_after and round(fitted.held_out_after, 3),
        cameras=_changes(given, rig, footage.rig, names),
    )
    write_model(take.camera_refinement, report)
    write_calibration_page(take)
    reporter.log(report.sentence)


def _refined(given: Rig, seen: Rig, corrections: dict[str, Correction]) -> Rig:
    """The calibrated cameras with corrections of the cameras that training sees, which may be smaller."""
    frame = own_frame(given)

    def of(camera: Camera) -> Camera:
        if camera.name not in corrections:
            return camera
        small = seen[camera.name]
        larger = camera.undistorted().width / small.width
        moved = corrections[camera.name].of(frame.camera(camera), larger)
        return frame.inverse.camera(moved)

    return Rig(tuple(of(camera) for camera in given), given.notes)


def _changes(given: Rig, rig: Rig, seen: Rig, names: Sequence[str]) -> dict[str, CameraChange]:
    changes = {}
    for name in names:
        before, after = given[name], rig[name]
        smaller = seen[name].width / before.undistorted().width
        sine = min(1.0, float(np.linalg.norm(after.rotation - before.rotation)) / 8**0.5)
        moved = np.hypot(after.cx - before.cx, after.cy - before.cy)
        changes[name] = CameraChange(
            degrees=round(float(np.degrees(2 * np.arcsin(sine))), 4),
            distance=round(float(np.linalg.norm(after.center - before.center)), 6),
            focal=round(smaller * (after.fx - before.fx), 3),
            principal_point=round(smaller * float(moved), 3),
            radial=round(_radial(after) - _radial(before), 6),
        )
    return changes


def _radial(camera: Camera) -> float:
    return float(camera.distortion[0]) if camera.distortion.size else 0.0
