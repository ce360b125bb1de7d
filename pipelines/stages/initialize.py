"""The stage `initialize`: initial points for each keyframe, sampled on the visual hull of the masks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from v3studio.pipelines.stages import Executor, stage_named
from v3studio.pipelines.stages.grouping import find_motion
from v3studio.pipelines.stages.inputs import Inputs
from v3studio.pipelines.stages.params import Params, derived_seed, key_of, settings_affecting
from v3studio.pipelines.stages.reporter import StageReporter
from v3studio.pipelines.stages.rig_check import check_rig
from v3studio.pipelines.stages.training_views import within_box
from v3studio.pipelines.takes.files.digests import digest_of_file
from v3studio.pipelines.takes.files.json_files import read_model, write_model
from v3studio.pipelines.takes.frames.groups import Group
from v3studio.pipelines.takes.results.point_files import write_mesh, write_points
from v3studio.pipelines.takes.results.records import digests_on_record, result_of
from v3studio.pipelines.takes.results.stage_files import InitialPointsReport
from v3studio.pipelines.takes.results.summaries import InitializeSummary
from v3studio.studio.atomic_files import atomic_path, remove
from v3studio.studio.errors import Message, StudioError
from v3studio.studio.memory_cache import OnDemand

if TYPE_CHECKING:
    from v3studio.studio.footage import Footage

_SEED_WORD = "initialise"  # part of the seed: with another word, the points of every take would change
_FEWEST_POINTS = 4  # that a keyframe can be trained from

STAGE = stage_named("initialize")


def params(inputs: Inputs) -> Params:
    """Training views, settings of the hull, and where groups begin."""
    return {
        **inputs.seen_by_training(),
        **settings_affecting(inputs.config, "initial_points"),
        "keyframes": [group.keyframe for group in inputs.groups],
        "frames": list(inputs.raw_footage.frames),
    }


def results(inputs: Inputs) -> list[Path]:
    """The motion, and mesh.ply and points.ply of each group."""
    return [inputs.take.motion] + [
        inputs.take.initialize_group(group.index) / name
        for group in inputs.groups
        for name in ("mesh.ply", "points.ply")
    ]


def units(inputs: Inputs) -> tuple[int, int, str] | None:
    """Groups with valid points."""
    groups, known = inputs.groups, digests_on_record(inputs.take, STAGE.name)

    def digest(file: Path) -> str | None:
        """Without reading files, gigabytes in a long take, of known digest or older than the report."""
        older = file.stat().st_mtime_ns <= file.with_name("report.json").stat().st_mtime_ns
        return known.get(file) or (None if older else digest_of_file(file))

    done = sum(_is_made(inputs, group, digest) for group in groups)
    return done, len(groups), "groups"


def run(inputs: Inputs, reporter: StageReporter, executor: Executor | None) -> InitializeSummary:
    """Find groups, and sample points for groups that have none."""
    for line in inputs.calibrated_footage.description.splitlines():
        reporter.log(line)  # what was found, in particular what auto chose
    for warning in inputs.calibrated_footage.warnings:
        reporter.warn(warning)
    first = 0.3 if find_motion(inputs, reporter.part("finding groups", 0.0, 0.3)) else 0.0
    groups = inputs.groups
    check_rig(inputs, group_key(inputs, groups[0]), groups[0].keyframe, reporter)
    if executor is not None:
        executor.run(STAGE, inputs, groups, reporter)
    counts = []
    for position, group in enumerate(groups):
        start, stop = (first + (1 - first) * (position + step) / len(groups) for step in (0, 1))
        if executor is None:  # else all are done, and looking again reads gigabytes in a long take
            with inputs.take.group_locked(STAGE.name, group.index, reporter.check):
                if not group_done(inputs, group):
                    _make(inputs, group, reporter, start, stop)
        report = read_model(inputs.take.initialize_group(group.index) / "report.json", InitialPointsReport)
        counts.append(report.faces)
    inputs.take.keep_groups(STAGE.name, len(groups))
    return InitializeSummary(groups=len(groups), points_per_group=inputs.config.initialize.points, faces=tuple(counts))


def group_key(inputs: Inputs, group: Group) -> str:
    parts = {**inputs.seen_by_training(), **settings_affecting(inputs.config, "initial_points")}
    return key_of(STAGE.name, STAGE.version, parts, result_of(inputs.take, "calibrate"), group.index, group.keyframe)


def run_group(inputs: Inputs, group: Group, reporter: StageReporter) -> None:
    _make(inputs, group, reporter, 0.0, 1.0)


def group_done(inputs: Inputs, group: Group) -> bool:
    return _is_made(inputs, group, digest_of_file)


def _is_made(inputs: Inputs, group: Group, digest: Callable[[Path], str | None]) -> bool:
    """Whether the report has the current key, and its files are there with the digests in it; `digest`: of a file; None
    if it is taken to be right."""
    folder = inputs.take.initialize_group(group.index)
    path = folder / "report.json"
    if not path.is_file() or path.stat().st_mtime_ns < inputs.since.get(STAGE.name, 0):
        return False
    report = read_model(path, InitialPointsReport)
    files = {folder / name: value for name, value in report.files.items()}
    return report.key == group_key(inputs, group) and all(
        file.is_file() and digest(file) in (None, value) for file, value in files.items()
    )


def _make(inputs: Inputs, group: Group, reporter: StageReporter, start: float, stop: float) -> None:
    from v3studio.studio.meshing import initialize_points

    footage, box = inputs.calibrated_footage, inputs.training_box
    found = initialize_points(
        OnDemand(footage.train_cameras, lambda camera: within_box(footage.view(camera, group.keyframe), box)),
        inputs.config.initialize,
        seed=derived_seed(inputs.config.run.seed, _SEED_WORD, group.index),
        progress=reporter.part(f"group {group.index}: visual hull", start, stop),
    )
    points, normals, colors = found.points, found.normals, found.colors
    if box is not None:
        inside = box.holds(points)
        points, normals, colors = points[inside], normals[inside], colors[inside]
        if len(points) < _FEWEST_POINTS:
            raise StudioError(
                "edits.nothing_in_box",
                f"only {len(points)} initial points of group {group.index} are inside of the crop box",
                file=inputs.take.edits,
                value=len(points),
                fix="Make the box larger, or crop without --training.",
                group=group.index,
                expected=_FEWEST_POINTS,
            )
    for warning in found.warnings:
        fields = {**warning.fields, "group": group.index}
        reporter.warn(replace(warning, problem=f"group {group.index}: {warning.problem}", fields=fields))
    if group.index == 0:
        _tell_coverage(footage, reporter, points, normals)
    folder = inputs.take.initialize_group(group.index)
    folder.mkdir(parents=True, exist_ok=True)
    with atomic_path(folder / "mesh.ply") as mesh, atomic_path(folder / "points.ply") as sampled:
        write_mesh(mesh, found.mesh.vertices, found.mesh.faces)
        write_points(sampled, points, normals, np.round(colors * 255))
        inputs.take.forget(STAGE.name)
        remove(folder / "report.json")  # of other points
    report = InitialPointsReport(
        key=group_key(inputs, group),
        keyframe=int(group.keyframe),
        points=len(points),
        vertices=len(found.mesh.vertices),
        faces=len(found.mesh.faces),
        disagreement={camera: round(float(value), 4) for camera, value in found.disagreement.items()},
        warnings=tuple(str(warning) for warning in found.warnings),
        files={name: digest_of_file(folder / name) for name in ("mesh.ply", "points.ply")},
    )
    write_model(folder / "report.json", report)
    reporter.metrics(report.model_dump(include={"points", "faces", "disagreement"}), group=group.index)


def _tell_coverage(footage: Footage, reporter: StageReporter, points: np.ndarray, normals: np.ndarray) -> None:
    """Log how well the training cameras cover the performer, and warn of gaps."""
    from v3studio.studio.coverage import LARGEST_GAPS, coverage

    found = coverage([footage.rig[name] for name in footage.train_cameras], points, normals, footage.rig.up)
    if found is None:
        return
    share, unseen = round(100 * found.outside), round(100 * found.unseen)
    reporter.log(
        f"coverage: {share}% of the directions around the performer are more than {found.angle:.0f} degrees from "
        f"the nearest training camera ({found.farthest:.0f} degrees at most); {unseen}% of the surface faces fewer "
        "than two cameras"
    )
    if found.outside > LARGEST_GAPS:
        problem = (
            f"no training camera is near {share}% of the directions around the performer (up to "
            f"{found.farthest:.0f} degrees away), and {unseen}% of the surface faces fewer than two cameras: "
            "views from there will be poor, and players fade them out"
        )
        fix = "Add cameras there, or let players show all views with bake.view_range = none."
        fields = {"setting": "bake.view_range", "outside": found.outside, "unseen": found.unseen}
        reporter.warn(Message("coverage.gaps", problem, fix=fix, fields=fields))
