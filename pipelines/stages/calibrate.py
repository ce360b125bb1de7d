"""The stage `calibrate`: cameras from a file, a calibration target, tie points, or structure from motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from v3studio.pipelines.reports.calibration import (
    calibration_figures,
    calibration_warnings,
    intrinsics_sentences,
    write_calibration_page,
)
from v3studio.pipelines.stages import Executor, stage_named
from v3studio.pipelines.stages.camera_file import camera_file, files_of
from v3studio.pipelines.stages.inputs import Inputs
from v3studio.pipelines.stages.known_cameras import (
    at_footage_size,
    check_sizes,
    focal_lengths,
    known_cameras,
    named_file,
)
from v3studio.pipelines.stages.params import Params, settings_affecting
from v3studio.pipelines.stages.reporter import StageReporter
from v3studio.pipelines.stages.rig_check import judge_by_images
from v3studio.pipelines.stages.target import calibrate_with_target, intrinsics_from_target, target_digest
from v3studio.pipelines.takes.files.digests import digest_of_file
from v3studio.pipelines.takes.files.json_files import write_model
from v3studio.pipelines.takes.results.point_files import write_points
from v3studio.pipelines.takes.results.stage_files import CamerasFromFile, CamerasReport
from v3studio.pipelines.takes.results.summaries import CalibrateSummary
from v3studio.pipelines.takes.take import Take
from v3studio.studio.atomic_files import atomic_path, remove
from v3studio.studio.calibration.report import CalibrationReport, IntrinsicsReport
from v3studio.studio.calibration.settings import CalibrateSettings
from v3studio.studio.camera_files import read_rig, write_rig
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
    given = given_cameras(inputs)
    config = inputs.config
    if given is not None:
        return {
            "camera file": _digest(given),
            "cameras without calibration": _uncalibrated(inputs),
            **settings_affecting(config, "cameras_from_file"),
        }
    if config.calibrate.board_images:
        return {"board footage": target_digest(inputs), **settings_affecting(config, "cameras_from_target")}
    if config.calibrate.tie_points:
        return {
            "tie points": _digest(_tie_file(inputs)),
            "sizes": {name: list(inputs.raw_footage.raw_size(name)) for name in inputs.raw_footage.camera_names},
            **settings_affecting(config, "cameras_from_points"),
            **_intrinsics_files(inputs),
        }
    masked = config.calibrate.look_at != "everything"
    return {
        "footage": inputs.footage_digest,
        "frames": frames_to_try(config.calibrate, inputs.raw_footage.frames),
        **settings_affecting(config, "cameras_from_images", *(("calibration_masks",) if masked else ())),
        **_intrinsics_files(inputs),
    }


def _uncalibrated(inputs: Inputs) -> list[str]:
    """Cameras of the footage that the take does not have, such as those that got masks since. Cameras that the footage
    has lost do not count: it may not be mounted."""
    try:
        known = read_rig(inputs.take.rig).names
    except StudioError:  # not there yet, or damaged, which is found elsewhere
        return []
    return [name for name in inputs.raw_footage.camera_names if name not in known]


def results(inputs: Inputs) -> list[Path]:
    """calibrate/rig.json."""
    return [inputs.take.rig]


def units(inputs: Inputs) -> tuple[int, int, str] | None:
    """None: the stage has no units."""
    return None


def run(inputs: Inputs, reporter: StageReporter, executor: Executor | None) -> CalibrateSummary:
    """Write rig.json and report.json; points.ply and report.html if the cameras were calibrated."""
    given = given_cameras(inputs)
    rig: Rig
    report: CamerasReport
    if given is not None:
        rig, report = _from_file(inputs, given)
    elif inputs.config.calibrate.board_images:
        result = calibrate_with_target(inputs, reporter)
        _keep_points(inputs.take, result.points, result.colors)
        rig, report = result.rig, result.report.model_copy(update={"source": "board"})
    elif inputs.config.calibrate.tie_points:
        rig, report = _from_tie_points(inputs, reporter)
    else:
        rig, report = _from_footage(inputs, reporter)
    inputs.take.forget(STAGE.name)
    with atomic_path(inputs.take.rig) as temporary:
        write_rig(rig, temporary)
    write_model(inputs.take.calibration_report, report)
    for path in (inputs.take.rig_verdict, inputs.take.camera_refinement, inputs.take.refined_rig):
        remove(path)  # of other cameras
    figures: dict[str, Any] = {}
    if isinstance(report, CalibrationReport):
        write_calibration_page(inputs.take)
        reporter.metrics(calibration_figures(report))
        for sentence in intrinsics_sentences(report):
            reporter.log(sentence)
        for warning in calibration_warnings(report):
            reporter.warn(warning)
        figures["mean_error_px"] = report.reprojection.mean
        if report.verdict is not None:
            figures["grade"] = report.verdict.grade
            reporter.log(f"cameras: {report.verdict.grade}. {report.verdict.reason}")
        if report.match_inlier_ratio is not None:
            figures["match_inlier_ratio"] = report.match_inlier_ratio
    else:
        for note in report.notes:
            reporter.log(note)
    inputs.forget_cameras()
    reporter.progress(1.0, "done")
    return CalibrateSummary(cameras=len(rig), source=report.source or "", **figures)


def _from_file(inputs: Inputs, path: Path) -> tuple[Rig, CamerasFromFile]:
    from v3studio.studio.footage import rig_of_footage

    footage = inputs.raw_footage
    rig = rig_of_footage(read_rig(path), inputs.config.capture, footage.camera_names, footage.without_masks)
    check_sizes(rig, footage, path)
    framed = frame_sentence(own_frame(rig))
    notes = rig.notes if framed is None else (*rig.notes, framed)
    if footage.without_masks:
        notes = (f"Without masks, so not used: {cameras_listed(footage.without_masks)}.", *notes)
    return rig, CamerasFromFile(source="file", file=str(path), notes=notes)


_MORE_FRAMES = (1, 3, 6, 12, 24)  # numbers of frames that are tried until they are enough
_SOLVING = 0.95  # part of the time in which the cameras are solved; then they are checked
_ENOUGH_POINTS = 300
"""Observations that each camera needs. With 30 to 170, 31 real cameras were folded; with 400, they were off by 2 cm."""


def frames_to_try(section: CalibrateSettings, frames: Sequence[int]) -> list[list[int]]:
    """The frames of the footage that cameras are calibrated from; several lists if the first may not be enough."""
    if section.frame is None:
        counts = _MORE_FRAMES if section.frame_count is None else (section.frame_count,)
        fewer = sorted({min(count, len(frames)) for count in counts})
        return [_spread(frames, count) for count in fewer]
    frame, count, setting = section.frame, section.frame_count or 1, "calibrate.frame"
    if count > 1:
        problem = f"calibrate.frame = {frame} selects one frame, but calibrate.frame_count = {count} requests several"
        fix = "Set only one of them."
        raise StudioError(
            "settings.conflict", problem, value=frame, fix=fix, setting=setting, other="calibrate.frame_count"
        )
    if frame not in frames:
        first, last = int(frames[0]), int(frames[-1])
        problem = f"calibrate.frame = {frame} is not among the used frames"
        fix = f"Used frames are {first} to {last}."
        raise StudioError(
            "settings.unknown_frame", problem, value=frame, fix=fix, setting=setting, first=first, last=last
        )
    return [[frame]]


def _spread(frames: Sequence[int], count: int) -> list[int]:
    """The centers of equal parts: at the ends of a take there is often nobody in view. One frame: the first."""
    if count == 1:
        return [int(frames[0])]
    return [int(frames[int((part + 0.5) * len(frames) / count)]) for part in range(count)]


def _from_footage(inputs: Inputs, reporter: StageReporter) -> tuple[Rig, CalibrationReport]:
    from v3studio.studio.calibration import floor_world

    footage, section = inputs.raw_footage, inputs.config.calibrate
    attempts = frames_to_try(section, footage.frames)
    names = footage.camera_names
    if section.frame_count is not None and section.frame_count > len(attempts[-1]):
        problem = f"calibrate.frame_count = {section.frame_count}, but only {len(attempts[-1])} frames are used"
        fields = {"setting": "calibrate.frame_count", "frames": len(attempts[-1])}
        reporter.warn(Message("footage.few_frames", problem, value=section.frame_count, fields=fields))
    if section.look_at != "everything" and inputs.config.capture.masks == "none":
        problem = f"calibrate.look_at = {section.look_at} needs masks, but capture.masks is none"
        value = section.look_at
        fix = "Set capture.masks, or calibrate.look_at to everything."
        raise StudioError(
            "settings.conflict", problem, value=value, fix=fix, setting="calibrate.look_at", other="capture.masks"
        )
    known, of_target = _known_intrinsics(inputs, reporter)
    stop = 0.2 if section.intrinsics_images else 0.0
    for number, frames in enumerate(attempts):
        last = number == len(attempts) - 1
        start, stop = stop, 1.0 if last else (1 + stop) / 2  # half of the rest is left for more frames
        solved = start + _SOLVING * (stop - start)
        solving = reporter.part(f"structure from motion, {counted(len(frames), 'frame')}", start, solved)
        try:
            result = _solved(inputs, frames, known, solving)
        except StudioError as error:
            if last or error.code not in ("calibration.unregistered", "calibration.no_solution"):
                raise
            reporter.log(f"{counted(len(frames), 'frame')}: {error.problem}. More frames are tried.")
            continue
        lacking = "" if last else _lacking(result.report)
        if not lacking:
            checking = reporter.part("checking the cameras", solved, stop)
            verdict = judge_by_images(inputs.opened(result.rig), frames[0], progress=checking)
            lacking = verdict.reason if verdict.grade == "wrong" else ""
        if last or not lacking:
            break
        reporter.log(f"{counted(len(frames), 'frame')}: {lacking} More frames are tried.")
    if few := _lacking(result.report):
        reporter.log(few)
    rig, points = result.rig, result.points
    report = result.report.model_copy(update={"source": "footage", "frames": frames, "verdict": verdict, **of_target})
    if section.floor:
        world, found = floor_world(rig, points)
        rig, points = world.rig(rig), world.points(points)
        report = report.model_copy(update={"floor": found})
    _keep_points(inputs.take, points, result.colors)
    return rig.subset(names), report


def _solved(
    inputs: Inputs, frames: Sequence[int], known: Mapping[str, Camera], progress: ProgressFn
) -> CalibrationResult:
    """Structure from motion on some frames."""
    from v3studio.studio.calibration import calibrate_from_images

    footage, section = inputs.raw_footage, inputs.config.calibrate
    names = footage.camera_names
    masks = None
    if section.look_at != "everything":
        room = section.look_at == "room"
        masks = {
            camera: [partial(_where_to_look, footage, camera, frame, room) for frame in frames] for camera in names
        }
    work = inputs.take.work(STAGE.name)
    work.mkdir(parents=True, exist_ok=True)
    return calibrate_from_images(
        {camera: [partial(footage.raw_image, camera, frame) for frame in frames] for camera in names},
        masks,
        workdir=work,
        known=known,
        poses=known_cameras(section, footage) if section.known in ("poses", "initial_poses") else None,
        focal_lengths={} if known else focal_lengths(footage, frames[0]),
        settings=section,
        threads=inputs.threads,
        seed=inputs.config.run.seed,
        progress=progress,
    )


def _lacking(report: CalibrationReport) -> str:
    """What more frames may improve, as a clause; "" if it is enough."""
    few = [name for name, one in report.cameras.items() if one.observations < _ENOUGH_POINTS]
    return f"{counted(len(few), 'camera')} with fewer than {_ENOUGH_POINTS} points." if few else ""


def _from_tie_points(inputs: Inputs, reporter: StageReporter) -> tuple[Rig, CalibrationReport]:
    from v3studio.studio.calibration import calibrate_from_tie_points, read_tie_points

    footage, section = inputs.raw_footage, inputs.config.calibrate
    names = footage.camera_names
    file = _tie_file(inputs)
    points = read_tie_points(file)
    strange = sorted({camera for point in points for camera in point.pixels} - set(names))
    if strange and not inputs.config.capture.cameras:
        problem = f"camera '{strange[0]}' not found in the footage"
        value = strange[0]
        fix = f"Cameras of the footage: {', '.join(names)}."
        raise StudioError(
            "tie_points.unknown_camera", problem, file=file, value=value, fix=fix, camera=strange[0], found=list(names)
        )
    known, of_target = _known_intrinsics(inputs, reporter)
    result = calibrate_from_tie_points(
        points,
        {name: footage.raw_size(name) for name in names},
        known=known,
        focal_lengths={} if known else focal_lengths(footage, footage.frames[0]),
        settings=section,
        seed=inputs.config.run.seed,
        progress=reporter.part("solving", 0.2 if section.intrinsics_images else 0.0, 1.0),
    )
    _keep_points(inputs.take, result.points, result.colors)
    about = {"source": "tie points", "file": str(file), **of_target}
    return result.rig, result.report.model_copy(update=about)


def _tie_file(inputs: Inputs) -> Path:
    return named_file(inputs.config.calibrate, "tie_points", inputs.capture.root)


def given_cameras(inputs: Inputs) -> Path | None:
    """The calibration file, if the stage only reads one; one found by capture.rig = auto is ignored if another source
    is set. Raises StudioError as the stage does."""
    section, rig = inputs.config.calibrate, inputs.config.capture.rig
    ways = [name for name in ("board_images", "tie_points") if getattr(section, name)]
    if rig not in (None, "auto"):
        ways.insert(0, "capture.rig")
    if len(ways) > 1:
        names = [way if "." in way else f"calibrate.{way}" for way in ways]
        problem = f"several camera sources are set: {' and '.join(names)}"
        fix = "Keep only one; capture.rig may be null."
        raise StudioError("settings.conflict", problem, fix=fix, setting=names[0], other=names[1])
    return None if ways and ways != ["capture.rig"] else camera_file(inputs.capture)


def _intrinsics_files(inputs: Inputs) -> Params:
    """Digests of the files that known intrinsics are read from (see `_known_intrinsics`)."""
    section = inputs.config.calibrate
    found: Params = {}
    if section.known_cameras:
        found["known"] = _digest(named_file(section, "known_cameras", inputs.capture.root))
    if section.intrinsics_images:
        found["board footage"] = target_digest(inputs)
    return found


def _keep_points(take: Take, points: np.ndarray, colors: np.ndarray) -> None:
    with atomic_path(take.calibration_points) as temporary:
        write_points(temporary, points, None, colors, doubles=True)


def _known_intrinsics(
    inputs: Inputs, reporter: StageReporter
) -> tuple[dict[str, Camera], dict[str, dict[str, IntrinsicsReport]]]:
    """Cameras with known intrinsics, at the footage's size, and the report's entry on images of the target, if any."""
    known: dict[str, Camera] = {}
    entry: dict[str, dict[str, IntrinsicsReport]] = {}
    if inputs.config.calibrate.intrinsics_images:
        known, reports = intrinsics_from_target(inputs, reporter, 0.0, 0.2)
        known = {name: at_footage_size(camera, inputs.raw_footage) for name, camera in known.items()}
        entry = {"intrinsics": reports}
    before = known_cameras(inputs.config.calibrate, inputs.raw_footage) or ()
    return {camera.name: camera for camera in before} | known, entry


def _where_to_look(footage: Footage, camera: str, frame: int, room: bool) -> np.ndarray:
    """(H, W) uint8: 255 where features may be detected."""
    performer = footage.raw_mask(camera, frame) >= 128
    return np.where(performer != room, 255, 0).astype(np.uint8)


def _digest(path: Path) -> str | dict[str, str]:
    """Digest of a file, or digests of the files in a folder or of a pattern by name."""
    several = [match.path for match in files_of(path)]
    if several:
        return {f"{file.parent.name}/{file.name}": digest_of_file(file) for file in several}
    if path.is_dir():
        files = [
            file for pattern in ("*", "[0-9]*/cameras.*", "[0-9]*/images.*") for file in sorted(path.glob(pattern))
        ]
        return {file.relative_to(path).as_posix(): digest_of_file(file) for file in files if file.is_file()}
    return digest_of_file(path)
