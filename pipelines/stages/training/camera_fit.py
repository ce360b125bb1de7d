"""Fits to all cameras, once, with the first group, before groups are trained: colors, refined cameras."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from v3studio.pipelines.events.cancellation import Cancellation
from v3studio.pipelines.stages.reporter import StageReporter
from v3studio.pipelines.stages.training.group_scheduler import run_groups
from v3studio.pipelines.stages.training.plan import TrainPlan
from v3studio.pipelines.takes.files.json_files import read_model
from v3studio.pipelines.takes.frames.groups import Group
from v3studio.pipelines.takes.results.point_files import read_points
from v3studio.pipelines.takes.results.stage_files import CameraColors, CameraRefinement
from v3studio.pipelines.takes.take import Take
from v3studio.studio.errors import StudioError

if TYPE_CHECKING:
    from torch import Tensor


def initial_points(take: Take, group: Group, device: str) -> tuple[Tensor, Tensor]:
    """(N, 3) means and colors of a group's initial points."""
    import torch

    points, colors = read_points(take.initialize_group(group.index) / "points.ply")
    return torch.from_numpy(points).to(device), torch.from_numpy(colors).to(device)


def check_first_points(take: Take, what: str) -> None:
    """Raise StudioError if the first group has no initial points. `what`: begins the sentence."""
    points = take.initialize_group(0) / "points.ply"
    if not points.is_file():
        problem = f"{what} the first group, which has no initial points yet"
        fix = "Run `v3studio initialize`."
        raise StudioError("training.no_first_points", problem, file=points, fix=fix, stage="initialize")


def ensure_fitted(
    plan: TrainPlan,
    reporter: StageReporter,
    file: Path,
    kind: type[CameraColors | CameraRefinement],
    key: str,
    fit: Callable[[], None],
) -> None:
    """Fit unless the result is there. Any worker may do it: the same inputs give the same bytes."""
    with plan.take.group_locked(file.stem, 0, reporter.check):
        with suppress(StudioError):  # missing or damaged
            if read_model(file, kind).key == key and file.stat().st_mtime_ns >= plan.since:
                return
        # with the threads of the first group, so that other workers get the same bits
        run_groups({0: fit}, 1, plan.threads, Cancellation())
