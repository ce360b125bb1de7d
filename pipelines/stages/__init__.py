"""The stages of a run, in order: the one table that the command line, the runner, the status and the window read.

Each stage is a module of this package with the functions of `StageCode`. It is imported on first use, so that listing
the stages is quick. To add a stage: write its module, add a row to `STAGES`, and name it in `dependencies` of those
that read its results.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Protocol, cast

if TYPE_CHECKING:
    from pathlib import Path

    from v3studio.pipelines.stages.inputs import Inputs
    from v3studio.pipelines.stages.params import Params
    from v3studio.pipelines.stages.reporter import StageReporter
    from v3studio.pipelines.takes.files.json_files import Result
    from v3studio.pipelines.takes.frames.groups import Group


@dataclass(frozen=True)
class Stage:
    """A step from footage to stream."""

    name: str  # as in the take, on the command line, and of its module
    title: str  # in the window, where `evaluate` is a part of Review
    help: str
    version: int  # raised whenever the format or meaning of its results changes; older results are then stale
    weight: float  # rough share of a run's time
    dependencies: tuple[str, ...] = ()
    # each group can run in another process or on another machine; the module has `GroupStageCode`
    by_group: bool = True
    needs_all_groups: bool = False  # a group needs the results of all groups of its dependencies
    renders: bool = True  # it uses the device `run.device`

    @property
    def code(self) -> StageCode:
        return cast("StageCode", import_module(f"{__name__}.{self.name}"))

    @property
    def group_code(self) -> GroupStageCode:
        """The functions of a stage with `by_group`."""
        return cast("GroupStageCode", self.code)

    def make_group(self, inputs: Inputs, group: Group, reporter: StageReporter) -> None:
        """Make a group's results, unless they are there or another process makes them."""
        with inputs.take.group_locked(self.name, group.index, reporter.check):
            if not self.group_code.group_done(inputs, group):
                self.group_code.run_group(inputs, group, reporter)


STAGES = (
    Stage(
        "calibrate", "Calibrate", "read the cameras from a file, or calibrate them", version=4, weight=1,
        by_group=False, renders=False,
    ),
    Stage(
        "initialize", "Initialize", "sample initial points on the visual hull of each keyframe", version=1,
        weight=6, dependencies=("calibrate",), renders=False,
    ),
    Stage(
        "set", "Set", "train the splats of the set behind the performer", version=1, weight=20,
        dependencies=("calibrate",), by_group=False,
    ),
    Stage(
        "train", "Train", "train the Gaussians", version=4, weight=85, dependencies=("calibrate", "initialize"),
    ),
    Stage(
        "bake", "Bake", "encode the trained Gaussians as a stream", version=3, weight=3, dependencies=("train",),
    ),
    Stage(
        "evaluate", "Review", "measure the quality on held-out cameras and write the report", version=4,
        weight=5, dependencies=("calibrate", "set", "train", "bake"), needs_all_groups=True,
    ),
)  # fmt: skip
"""All stages, in the order in which they run."""

STAGE_NAMES = tuple(stage.name for stage in STAGES)
GROUP_STAGES = tuple(stage for stage in STAGES if stage.by_group)  # those whose groups can run elsewhere

CHAIN = tuple(stage.name for stage in GROUP_STAGES if not stage.needs_all_groups)
"""Stages of a group that need nothing of other groups."""


def stage_named(name: str) -> Stage:
    return next(stage for stage in STAGES if stage.name == name)


class StageCode(Protocol):
    """The functions in the module of a stage. They read and write the take and call `studio`; they hold no state."""

    def params(self, inputs: Inputs) -> Params:
        """Settings and inputs that affect the results; the runner adds the results of `Stage.dependencies`."""

    def results(self, inputs: Inputs) -> list[Path]:
        """Files that the stage writes; later stages depend on their content."""

    def units(self, inputs: Inputs) -> tuple[int, int, str] | None:
        """Number of finished valid units, number of all units, their name ("frames"); None if it has no units."""

    def run(self, inputs: Inputs, reporter: StageReporter, executor: Executor | None) -> Result:
        """Write the results, and return the main figures (words for them: `takes.results.summaries`); finished units
        kept.

        The reporter receives progress, figures and warnings; it raises Cancelled when the run is cancelled. `executor`:
        runs groups elsewhere; None: in this process. StudioError for bad input.
        """


class GroupStageCode(StageCode, Protocol):
    """A stage whose groups need nothing of each other. `run` then finds them finished and puts them together."""

    def group_key(self, inputs: Inputs, group: Group) -> str:
        """Digest of everything that the group's results are made from."""

    def group_done(self, inputs: Inputs, group: Group) -> bool:
        """Return whether the group's results are there and up to date."""

    def run_group(self, inputs: Inputs, group: Group, reporter: StageReporter) -> None:
        """Make the group's results; continues from the last finished frame or checkpoint. The caller holds the group's
        lock."""


class Executor(Protocol):
    """Runs groups of a stage somewhere else."""

    def run(
        self,
        stage: Stage,
        inputs: Inputs,
        groups: Sequence[Group],
        reporter: StageReporter,
        finished: Callable[[Group], None] = lambda group: None,
    ) -> None:
        """Run these groups, those that are not up to date; returns when the results of all are in the take.

        The reporter is used as in a local run; `finished` is called after each group, in this thread. StudioError if a
        group failed; the others are cancelled. Cancelled if the run was.
        """
