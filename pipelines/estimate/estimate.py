"""Minutes, memory and bytes of each stage, from counted work and measured seconds per unit."""

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import partial

from v3studio.pipelines.estimate.rehearsal import Measured
from v3studio.pipelines.estimate.work import Work
from v3studio.pipelines.stages import STAGES
from v3studio.pipelines.takes.frames.groups import Group
from v3studio.studio.json_types import JsonObject
from v3studio.studio.training import joint_steps
from v3studio.studio.training.camera_refinement import all_steps
from v3studio.studio.training.pruning import prune_rounds

UNCERTAINTY = 0.25
"""Share of the time: about one run in ten is further off, most often since splats become more or fewer than assumed."""

_BYTES_A_MASK_PIXEL, _BYTES_A_VOXEL = 6, 16
"""Memory of the visual hull: the longest side of a box is about twice the others, so a quarter of the voxels."""

_BYTES_A_SPLAT = 0.96  # of a stream per splat and frame at QP 24: measured on walk16, groups of 15 frames
_BYTES_A_QP = 0.0754  # natural logarithm of the ratio of bytes from one QP to the next lower one, on the same capture
STREAM_SPREAD = 2  # fast motion needs about twice the bytes, slow motion half


@dataclass(frozen=True)
class StageEstimate:
    """Expected seconds, peak memory and bytes on disk of a stage; None: unknown. `remark`: what they assume."""

    stage: str
    seconds: float | None
    memory: int | None
    bytes: int | None
    remark: str = ""


@dataclass(frozen=True)
class Estimate:
    """A run. `splats`: per frame, assumed. `processor`: share of the processor that the measurement got, 0 to 1."""

    stages: tuple[StageEstimate, ...]
    splats: int
    processor: float

    @property
    def seconds(self) -> float:
        """Expected duration of all stages that can be estimated."""
        return sum(stage.seconds or 0.0 for stage in self.stages)

    @property
    def range(self) -> tuple[float, float]:
        """Seconds between which most runs end."""
        return self.seconds * (1 - UNCERTAINTY), self.seconds * (1 + UNCERTAINTY)

    @property
    def memory(self) -> int:
        """Expected peak memory of the process, bytes."""
        return max(stage.memory or 0 for stage in self.stages)

    def to_json(self) -> JsonObject:
        """JSON-ready, for `--json`."""
        low, high = self.range
        return {
            "stages": [asdict(stage) for stage in self.stages],
            "seconds": round(self.seconds, 1),
            "seconds_low": round(low, 1),
            "seconds_high": round(high, 1),
            "memory": self.memory,
            "splats": self.splats,
            "processor": round(self.processor, 3),
        }


def estimate(work: Work, measured: Measured, qp: int | None) -> Estimate:
    """The stages after calibration. `qp`: of the stream; None: of unknown size."""
    known: dict[str, Callable[[Work, Measured], StageEstimate]] = {
        "initialize": _initialize,
        "train": _train,
        "bake": partial(_bake, qp=qp),
        "evaluate": _evaluate,
    }
    stages = (
        known[stage.name](work, measured)
        if stage.name in known
        else StageEstimate(stage.name, None, None, None, "not estimated")
        for stage in STAGES[1:]
    )
    return Estimate(tuple(stages), work.splats, measured.processor)


def _initialize(work: Work, measured: Measured) -> StageEstimate:
    groups, cameras = len(work.groups), work.train_cameras
    opening = measured.camera * (cameras + work.held_out_cameras) / work.threads
    hull = measured.hull_fixed * cameras / min(cameras, 12) + measured.hull_square * work.resolution**2
    return StageEstimate(
        "initialize",
        groups * hull + opening + measured.view * cameras * groups / work.threads,
        measured.memory + _BYTES_A_MASK_PIXEL * work.pixels + _BYTES_A_VOXEL * work.resolution**3,
        groups * (work.points * 27 + 100_000 * 19),
    )


def _train(work: Work, measured: Measured) -> StageEstimate:
    # Reading the footage shares the processor with training. Images are masked once if the cache holds them.
    reading = measured.view * work.train_cameras * work.frames / work.threads
    refined = all_steps(work.train, work.train_cameras, work.held_out_cameras) if work.refines else 0
    refinement = measured.keyframe_step * work.points * refined
    sh = 3 * (work.train.sh_degree + 1) ** 2
    return StageEstimate(
        "train",
        work.waves({count: _group(work, measured, count) for count in set(work.groups)}) + refinement + reading,
        measured.memory + work.at_once * work.memory_of_group,
        work.frames * work.splats * 4 * (11 + sh) * (2 if work.train.joint_iterations else 1),
        "assumes train.densify_max_splats splats before pruning, and the longest groups until they are known",
    )


def _bake(work: Work, measured: Measured, qp: int | None) -> StageEstimate:
    return StageEstimate(
        "bake",
        measured.baked_frame * work.frames,
        measured.memory,
        None if qp is None else round(work.frames * work.splats * _BYTES_A_SPLAT * math.exp(_BYTES_A_QP * (24 - qp))),
        "not estimated with a ladder, a level or a size" if qp is None else "half to twice, depending on the motion",
    )


def _evaluate(work: Work, measured: Measured) -> StageEstimate:
    views = (work.held_out_cameras or work.train_cameras) * work.frames
    return StageEstimate("evaluate", (measured.evaluated_view + measured.view) * views, measured.memory, None)


def _group(work: Work, measured: Measured, frames: int) -> float:
    """Seconds to train a group of this many frames."""
    train, before = work.train, work.splats_before_pruning
    after = prune_rounds(train, before) * train.prune_finetune_iterations
    seconds = measured.keyframe_step * (before * train.keyframe_iterations + (before + work.splats) / 2 * after)
    for side in Group(index=0, first=0, frames=tuple(range(frames))).sides:
        for number in range(len(side)):
            seconds += measured.frame + measured.motion_step * train.motion_steps(number == 0)
            seconds += measured.finetune_step * train.finetune_iterations
    return seconds + measured.finetune_step * joint_steps(train, frames)
