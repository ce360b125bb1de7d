"""The stages in the order in which they run. Each reads the take, calls `studio`, and writes to the take."""

from pipelines.stages.bake import BakeStage
from pipelines.stages.base import GroupStage, Stage
from pipelines.stages.calibrate import CalibrateStage
from pipelines.stages.evaluate import EvaluateStage
from pipelines.stages.initialize import InitializeStage
from pipelines.stages.train import TrainStage

GROUP_STAGES: tuple[GroupStage, ...] = (InitializeStage(), TrainStage(), BakeStage(), EvaluateStage())
"""Those whose groups can be run elsewhere, in order."""

STAGES: tuple[Stage, ...] = (CalibrateStage(), *GROUP_STAGES)


def stage_named(name: str) -> Stage:
    """The stage of that name."""
    return next(stage for stage in STAGES if stage.name == name)


__all__ = ["GROUP_STAGES", "STAGES", "GroupStage", "Stage", "stage_named"]
