"""What is fitted to all cameras once, with the first group, before groups are trained: colors, refined cameras."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from v3studio.pipelines.events.cancellation import Cancellation
from v3studio.pipelines.stages.group_scheduler import run_groups, threads_of_groups
from v3studio.pipelines.stages.inputs import Inputs
from v3studio.pipelines.stages.params import Params, key_of
from v3studio.pipelines.stages.reporter import StageReporter
from v3studio.pipelines.takes.files.json_files import read_model
from v3studio.pipelines.takes.frames.groups import Group
from v3studio.pipelines.takes.results.point_files import read_points
from v3studio.pipelines.takes.results.records import result_of
from v3studio.pipelines.takes.results.stage_files import CameraColors, CameraRefinement, InitialPointsReport
from v3studio.pipelines.takes.take import Take
from v3studio.studio.errors import StudioError

if TYPE_CHECKING:
    from torch import Tensor

_Fitted = CameraColors | CameraRefinement


def fit_key(take: Take, first: Group, what: str, version: int, recipe: Params, *more: Any) -> str:
    """Digest of what is fitted to the cameras with the first group; `more`: what else it is made from."""
    files = initial_files(take, first)
    return key_of(what, version, recipe, result_of(take, "calibrate"), files, first.keyframe, *more)


def initial_files(take: Take, group: Group) -> Any:
    """Digests of a group's initial points, from their report; None if there are none."""
    report = take.initialize_group(group.index) / "report.json"
    return read_model(report, InitialPointsReport).files if report.is_file() else None


def initial_points(inputs: Inputs, group: Group) -> tuple[Tensor, Tensor]:
    """(N, 3) means and colors of a group's initial points, on the device of the run."""
    import torch

    points, colors = read_points(inputs.take.initialize_group(group.index) / "points.ply")
    return torch.from_numpy(points).to(inputs.device), torch.from_numpy(colors).to(inputs.device)


def check_first_points(take: Take, what: str) -> None:
    """Raise StudioError if the first group has no initial points. `what`: begins the sentence."""
    points = take.initialize_group(0) / "points.ply"
    if not points.is_file():
        problem = f"{what} the first group, which has no initial points yet"
        fix = "Run `v3studio initialize`."
        raise StudioError("training.no_first_points", problem, file=points, fix=fix, stage="initialize")


def ensure_fitted(
    inputs: Inputs,
    reporter: StageReporter,
    file: Path,
    kind: type[_Fitted],
    key: str,
    fit: Callable[[], None],
) -> None:
    """Fit unless the result is there. Any worker may do it: the same inputs give the same bytes."""
    with inputs.take.group_locked(file.stem, 0, reporter.check):
        with suppress(StudioError):  # missing or damaged
            if read_model(file, kind).key == key and file.stat().st_mtime_ns >= inputs.since.get("train", 0):
                return
        # with the threads of the first group, so that other workers get the same bits
        run_groups({0: fit}, 1, threads_of_groups(inputs), Cancellation())
