"""The stage `calibrate`: cameras from a file, a calibration target, tie points, or structure from motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from v3studio.pipelines.reports.calibration import (
    calibration_figures,
    calibration_warnings,
    intrinsics_sentences,
    write_calibration_page,
)
from v3studio.pipelines.stages import Executor, stage_named
from v3studio.pipelines.stages.calibrate_plan import CalibratePlan
from v3studio.pipelines.stages.camera_file import rig_of_capture
from v3studio.pipelines.stages.inputs import Inputs
from v3studio.pipelines.stages.known_cameras import (
    at_footage_size,
    check_sizes,
    focal_lengths,
    known_cameras,
)
from v3studio.pipelines.stages.params import Params
from v3studio.pipelines.stages.reporter import StageReporter
from v3studio.pipelines.stages.rig_check import judge_by_images
from v3studio.pipelines.stages.target import calibrate_with_target, intrinsics_from_target
from v3studio.pipelines.takes.files.json_files import write_model
from v3studio.pipelines.takes.results.point_files import write_points
from v3studio.pipelines.takes.results.stage_files import CamerasFromFile, CamerasReport
from v3studio.pipelines.takes.results.summaries import CalibrateSummary
from v3studio.pipelines.takes.take import Take
from v3studio.studio.atomic_files import atomic_path, remove
from v3studio.studio.calibration.report import CalibrationReport, IntrinsicsReport
from v3studio.studio.camera_files import write_rig
from v3studio.studio.cameras import Camera, Rig
from v3studio.studio.counts import cameras_listed, counted
from v3studio.studio.errors import Message, StudioError
from v3studio.studio.own_frame import frame_sentence, own_frame
from v3studio.studio.progress import ProgressFn

if TYPE_CHECKING:
    from v3studio.studio.calibration import CalibrationResult
    from v3studio.studio.footage import Footage

STAGE = stage_named("calibrate")


def params(inputs: Inputs) -> Params:
    """Content of the calibration file, or the footage and calibration settings."""
    return CalibratePlan(inputs).params()


def results(inputs: Inputs) -> list[Path]:
    """calibrate/rig.json."""
    return [inputs.take.rig]


def units(inputs: Inputs) -> tuple[int, int, str] | None:
    """None: the stage has no units."""
    return None


def run(inputs: Inputs, reporter: StageReporter, executor: Executor | None) -> CalibrateSummary:
    """Write rig.json and report.json; points.ply and report.html if the cameras were calibrated."""
    plan = CalibratePlan(inputs)
    rig: Rig
    report: CamerasReport
    if plan.camera_file is not None:
        rig, report = _from_file(plan, plan.camera_file)
    elif plan.source == "board":
        names = plan.footage.camera_names
        result = calibrate_with_target(plan.settings, plan.capture, names, plan.threads, reporter)
        _keep_points(plan.take, result.points, result.colors)
        rig, report = result.rig, result.report.model_copy(update={"source": "board"})
    elif plan.source == "tie points":
        rig, report = _from_tie_points(plan, reporter)
    else:
        rig, report = _from_footage(plan, reporter)
    _write(plan, rig, report)
    _tell(report, reporter)
    reporter.progress(1.0, "done")
    summary = CalibrateSummary(cameras=len(rig), source=report.source or "")
    if not isinstance(report, CalibrationReport):
        return summary
    figures = {
        "mean_error_px": report.reprojection.mean,
        "grade": None if report.verdict is None else report.verdict.grade,
        "match_inlier_ratio": report.match_inlier_ratio,
    }
    return summary.model_copy(update={name: figure for name, figure in figures.items() if figure is not None})


def _write(plan: CalibratePlan, rig: Rig, report: CamerasReport) -> None:
    """Replace the take's cameras."""
    take = plan.take
    take.forget(STAGE.name)
    with atomic_path(take.rig) as temporary:
        write_rig(rig, temporary)
    write_model(take.calibration_report, report)
    for path in (take.rig_verdict, take.card, take.card_picture, take.camera_refinement, take.refined_rig):
        remove(path)  # of other cameras
    if isinstance(report, CalibrationReport):
        write_calibration_page(take)
    plan.inputs.forget_cameras()


def _tell(report: CamerasReport, reporter: StageReporter) -> None:
    """Report how the cameras were found, and how good they are."""
    if not isinstance(report, CalibrationReport):
        for note in report.notes:
            reporter.log(note)
        return
    reporter.metrics(calibration_figures(report))
    for sentence in intrinsics_sentences(report):
        reporter.log(sentence)
    for warning in calibration_warnings(report):
        reporter.warn(warning)
    if report.verdict is not None:
        reporter.log(f"cameras: {report.verdict.grade}. {report.verdict.reason}")


def _from_file(plan: CalibratePlan, path: Path) -> tuple[Rig, CamerasFromFile]:
    footage = plan.footage
    rig = rig_of_capture(path, footage)
    check_sizes(rig, footage, path)
    framed = frame_sentence(own_frame(rig))
    notes = rig.notes if framed is None else (*rig.notes, framed)
    if footage.without_masks:
        notes = (f"Without masks, so not used: {cameras_listed(footage.without_masks)}.", *notes)
    return rig, CamerasFromFile(source="file", file=str(path), notes=notes)


_SOLVING = 0.95  # part of the time in which the cameras are solved; then they are checked
_ENOUGH_POINTS = 300
"""Observations that each camera needs. With 30 to 170, 31 real cameras were folded; with 400, they were off by 2 cm."""


def _from_footage(plan: CalibratePlan, reporter: StageReporter) -> tuple[Rig, CalibrationReport]:
    from v3studio.studio.calibration import floor_world

    footage, section = plan.footage, plan.settings
    attempts = plan.attempts
    names = footage.camera_names
    if section.frame_count is not None and section.frame_count > len(attempts[-1]):
        problem = f"calibrate.frame_count = {section.frame_count}, but only {len(attempts[-1])} frames are used"
        fields = {"setting": "calibrate.frame_count", "frames": len(attempts[-1])}
        reporter.warn(Message("footage.few_frames", problem, value=section.frame_count, fields=fields))
    if section.look_at != "everything" and plan.config.capture.masks == "none":
        problem = f"calibrate.look_at = {section.look_at} needs masks, but capture.masks is none"
        value = section.look_at
        fix = "Set capture.masks, or calibrate.look_at to everything."
        raise StudioError(
            "settings.conflict", problem, value=value, fix=fix, setting="calibrate.look_at", other="capture.masks"
        )
    known, of_target = _known_intrinsics(plan, reporter)
    stop = 0.2 if section.intrinsics_images else 0.0
    for number, frames in enumerate(attempts):
        last = number == len(attempts) - 1
        start, stop = stop, 1.0 if last else (1 + stop) / 2  # half of the rest is left for more frames
        solved = start + _SOLVING * (stop - start)
        solving = reporter.part(f"structure from motion, {counted(len(frames), 'frame')}", start, solved)
        try:
            result = _solved(plan, frames, known, solving)
        except StudioError as error:
            if last or error.code not in ("calibration.unregistered", "calibration.no_solution"):
                raise
            reporter.log(f"{counted(len(frames), 'frame')}: {error.problem}. More frames are tried.")
            continue
        lacking = "" if last else _lacking(result.report)
        if not lacking:
            checking = reporter.part("checking the cameras", solved, stop)
            verdict = judge_by_images(plan.inputs.opened(result.rig), frames[0], progress=checking)
            lacking = verdict.reason if verdict.grade == "wrong" else ""
        if last or not lacking:
            break
        reporter.log(f"{counted(len(frames), 'frame')}: {lacking} More frames are tried.")
    if few := _lacking(result.report):
        reporter.log(few)
    rig, points = result.rig, result.points
    report = result.report.model_copy(update={"source": "footage", "frames": frames, "verdict": verdict, **of_target})
    if section.floor:
        world, floor = floor_world(rig, points)
        rig, points = world.rig(rig), world.points(points)
        report = report.model_copy(update={"floor": floor})
    _keep_points(plan.take, points, result.colors)
    return rig.subset(names), report


def _solved(
    plan: CalibratePlan, frames: Sequence[int], known: Mapping[str, Camera], progress: ProgressFn
) -> CalibrationResult:
    """Structure from motion on some frames."""
    from v3studio.studio.calibration import calibrate_from_images

    footage, section = plan.footage, plan.settings
    names = footage.camera_names
    masks = None
    if section.look_at != "everything":
        room = section.look_at == "room"
        masks = {
            camera: [partial(_where_to_look, footage, camera, frame, room) for frame in frames] for camera in names
        }
    work = plan.take.work(STAGE.name)
    work.mkdir(parents=True, exist_ok=True)
    return calibrate_from_images(
        {camera: [partial(footage.raw_image, camera, frame) for frame in frames] for camera in names},
        masks,
        workdir=work,
        known=known,
        poses=known_cameras(section, footage) if section.known in ("poses", "initial_poses") else None,
        focal_lengths={} if known else focal_lengths(footage, frames[0]),
        settings=section,
        threads=plan.threads,
        seed=plan.config.run.seed,
        progress=progress,
    )


def _lacking(report: CalibrationReport) -> str:
    """Things that more frames may improve, as a clause; "" if it is enough."""
    few = [name for name, camera in report.cameras.items() if camera.observations < _ENOUGH_POINTS]
    return f"{counted(len(few), 'camera')} with fewer than {_ENOUGH_POINTS} points." if few else ""


def _from_tie_points(plan: CalibratePlan, reporter: StageReporter) -> tuple[Rig, CalibrationReport]:
    from v3studio.studio.calibration import calibrate_from_tie_points, read_tie_points

    footage, section = plan.footage, plan.settings
    names = footage.camera_names
    file = plan.tie_file
    points = read_tie_points(file)
    strange = sorted({camera for point in points for camera in point.pixels} - set(names))
    if strange and not plan.config.capture.cameras:
        problem = f"camera '{strange[0]}' not found in the footage"
        value = strange[0]
        fix = f"Cameras of the footage: {', '.join(names)}."
        raise StudioError(
            "tie_points.unknown_camera", problem, file=file, value=value, fix=fix, camera=strange[0], found=list(names)
        )
    known, of_target = _known_intrinsics(plan, reporter)
    result = calibrate_from_tie_points(
        points,
        {name: footage.raw_size(name) for name in names},
        known=known,
        focal_lengths={} if known else focal_lengths(footage, footage.frames[0]),
        settings=section,
        seed=plan.config.run.seed,
        progress=reporter.part("solving", 0.2 if section.intrinsics_images else 0.0, 1.0),
    )
    _keep_points(plan.take, result.points, result.colors)
    about = {"source": "tie points", "file": str(file), **of_target}
    return result.rig, result.report.model_copy(update=about)


def _keep_points(take: Take, points: np.ndarray, colors: np.ndarray) -> None:
    with atomic_path(take.calibration_points) as temporary:
        write_points(temporary, points, None, colors, doubles=True)


def _known_intrinsics(
    plan: CalibratePlan, reporter: StageReporter
) -> tuple[dict[str, Camera], dict[str, dict[str, IntrinsicsReport]]]:
    """Cameras with known intrinsics, at the footage's size, and the report's entry on images of the target, if any."""
    known: dict[str, Camera] = {}
    entry: dict[str, dict[str, IntrinsicsReport]] = {}
    if plan.settings.intrinsics_images:
        detecting = reporter.part("detecting the target", 0.0, 0.2)
        names = plan.footage.camera_names
        known, reports = intrinsics_from_target(plan.settings, plan.capture, names, plan.threads, detecting)
        known = {name: at_footage_size(camera, plan.footage) for name, camera in known.items()}
        entry = {"intrinsics": reports}
    before = known_cameras(plan.settings, plan.footage) or ()
    return {camera.name: camera for camera in before} | known, entry


def _where_to_look(footage: Footage, camera: str, frame: int, room: bool) -> np.ndarray:
    """(H, W) uint8: 255 where features may be detected."""
    performer = footage.raw_mask(camera, frame) >= 128
    return np.where(performer != room, 255, 0).astype(np.uint8)
