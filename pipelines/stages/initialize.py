"""The stage `initialize`: initial points for each keyframe, sampled on the visual hull of the masks."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from v3studio.pipelines.stages import Executor
from v3studio.pipelines.stages.card import check_card
from v3studio.pipelines.stages.grouping import find_motion
from v3studio.pipelines.stages.initialize_plan import STAGE, InitializePlan
from v3studio.pipelines.stages.inputs import Inputs
from v3studio.pipelines.stages.params import Params, derived_seed
from v3studio.pipelines.stages.reporter import StageReporter
from v3studio.pipelines.stages.rig_check import check_rig
from v3studio.pipelines.stages.training.views import within_box
from v3studio.pipelines.takes.files.digests import digest_of_file
from v3studio.pipelines.takes.files.json_files import read_model, write_model
from v3studio.pipelines.takes.frames.groups import Group
from v3studio.pipelines.takes.results.point_files import write_mesh, write_points
from v3studio.pipelines.takes.results.records import digests_on_record
from v3studio.pipelines.takes.results.stage_files import InitialPointsReport
from v3studio.pipelines.takes.results.summaries import InitializeSummary
from v3studio.studio.atomic_files import atomic_path, remove
from v3studio.studio.errors import Message, StudioError
from v3studio.studio.memory_cache import OnDemand

if TYPE_CHECKING:
    from v3studio.studio.footage import Footage

_SEED_WORD = "initialise"  # part of the seed: with another word, the points of every take would change
_FEWEST_POINTS = 4  # that a keyframe can be trained from


def params(inputs: Inputs) -> Params:
    """Training views, settings of the hull, and where groups begin."""
    plan = InitializePlan(inputs)
    return {
        **plan.recipe,
        "keyframes": [group.keyframe for group in plan.groups],
        "frames": list(plan.frames),
    }


def results(inputs: Inputs) -> list[Path]:
    """The motion, and mesh.ply and points.ply of each group."""
    folders = [inputs.take.initialize_group(group.index) for group in inputs.groups]
    return [inputs.take.motion, *(folder / name for folder in folders for name in ("mesh.ply", "points.ply"))]


def units(inputs: Inputs) -> tuple[int, int, str] | None:
    """Groups with valid points."""
    plan, known = InitializePlan(inputs), digests_on_record(inputs.take, STAGE.name)

    def digest(file: Path) -> str | None:
        """Return the digest without reading files of known digest or older than the report: gigabytes in a long
        take."""
        older = file.stat().st_mtime_ns <= file.with_name("report.json").stat().st_mtime_ns
        return known.get(file) or (None if older else digest_of_file(file))

    groups = plan.groups
    return sum(plan.is_made(group, digest) for group in groups), len(groups), "groups"


def run(inputs: Inputs, reporter: StageReporter, executor: Executor | None) -> InitializeSummary:
    """Find groups, and sample points for groups that have none."""
    plan = InitializePlan(inputs)
    for line in plan.footage.description.splitlines():
        reporter.log(line)  # what was found, in particular what auto chose
    for warning in plan.footage.warnings:
        reporter.warn(warning)
    check_card(plan, reporter)
    first = 0.3 if find_motion(plan, reporter.part("finding masks and groups", 0.0, 0.3)) else 0.0
    groups = plan.groups
    check_rig(plan, groups[0], reporter)
    if executor is not None:
        executor.run(STAGE, inputs, groups, reporter)
    counts = []
    for position, group in enumerate(groups):
        start, stop = (first + (1 - first) * (position + step) / len(groups) for step in (0, 1))
        if executor is None:  # else all are done, and looking again reads gigabytes in a long take
            with plan.take.group_locked(STAGE.name, group.index, reporter.check):
                if not plan.is_made(group, digest_of_file):
                    _make(plan, group, reporter, start, stop)
        report = read_model(plan.take.initialize_group(group.index) / "report.json", InitialPointsReport)
        counts.append(report.faces)
    plan.take.keep_groups(STAGE.name, len(groups))
    return InitializeSummary(groups=len(groups), points_per_group=plan.settings.points, faces=tuple(counts))


def group_key(inputs: Inputs, group: Group) -> str:
    return InitializePlan(inputs).key(group)


def run_group(inputs: Inputs, group: Group, reporter: StageReporter) -> None:
    _make(InitializePlan(inputs), group, reporter, 0.0, 1.0)


def group_done(inputs: Inputs, group: Group) -> bool:
    return InitializePlan(inputs).is_made(group, digest_of_file)


def _make(plan: InitializePlan, group: Group, reporter: StageReporter, start: float, stop: float) -> None:
    """Make the initial points of a group; `start` and `stop`: of the stage's progress."""
    from v3studio.studio.meshing import initialize_points

    footage, box = plan.footage, plan.box
    hull = initialize_points(
        OnDemand(footage.train_cameras, lambda camera: within_box(footage.view(camera, group.keyframe), box)),
        plan.settings,
        seed=derived_seed(plan.seed, _SEED_WORD, group.index),
        progress=reporter.part(f"group {group.index}: visual hull", start, stop),
    )
    points, normals, colors = hull.points, hull.normals, hull.colors
    if box is not None:
        inside = box.holds(points)
        points, normals, colors = points[inside], normals[inside], colors[inside]
        if len(points) < _FEWEST_POINTS:
            raise StudioError(
                "edits.nothing_in_box",
                f"only {len(points)} initial points of group {group.index} are inside of the crop box",
                file=plan.take.edits,
                value=len(points),
                fix="Make the box larger, or crop without --training.",
                group=group.index,
                expected=_FEWEST_POINTS,
            )
    for warning in hull.warnings:
        fields = {**warning.fields, "group": group.index}
        reporter.warn(replace(warning, problem=f"group {group.index}: {warning.problem}", fields=fields))
    if group.index == 0:
        _tell_coverage(footage, reporter, points, normals)
    folder = plan.take.initialize_group(group.index)
    folder.mkdir(parents=True, exist_ok=True)
    with atomic_path(folder / "mesh.ply") as mesh, atomic_path(folder / "points.ply") as sampled:
        write_mesh(mesh, hull.mesh.vertices, hull.mesh.faces)
        write_points(sampled, points, normals, np.round(colors * 255))
        plan.take.forget(STAGE.name)
        remove(folder / "report.json")  # of other points
    report = InitialPointsReport(
        key=plan.key(group),
        keyframe=int(group.keyframe),
        points=len(points),
        vertices=len(hull.mesh.vertices),
        faces=len(hull.mesh.faces),
        disagreement={camera: round(float(value), 4) for camera, value in hull.disagreement.items()},
        warnings=tuple(str(warning) for warning in hull.warnings),
        files={name: digest_of_file(folder / name) for name in ("mesh.ply", "points.ply")},
    )
    write_model(folder / "report.json", report)
    reporter.metrics(report.model_dump(include={"points", "faces", "disagreement"}), group=group.index)


def _tell_coverage(footage: Footage, reporter: StageReporter, points: np.ndarray, normals: np.ndarray) -> None:
    """Log how well the training cameras cover the performer, and warn of gaps."""
    from v3studio.studio.calibration.coverage import LARGEST_GAPS, coverage

    gaps = coverage([footage.rig[name] for name in footage.train_cameras], points, normals, footage.rig.up)
    if gaps is None:
        return
    share, unseen = round(100 * gaps.outside), round(100 * gaps.unseen)
    reporter.log(
        f"coverage: {share}% of the directions around the performer are more than {gaps.angle:.0f} degrees from "
        f"the nearest training camera ({gaps.farthest:.0f} degrees at most); {unseen}% of the surface faces fewer "
        "than two cameras"
    )
    if gaps.outside > LARGEST_GAPS:
        problem = (
            f"no training camera is near {share}% of the directions around the performer (up to "
            f"{gaps.farthest:.0f} degrees away), and {unseen}% of the surface faces fewer than two cameras: "
            "views from there will be poor, and players fade them out"
        )
        fix = "Add cameras there, or let players show all views with bake.view_range = none."
        fields = {"setting": "bake.view_range", "outside": gaps.outside, "unseen": gaps.unseen}
        reporter.warn(Message("coverage.gaps", problem, fix=fix, fields=fields))
