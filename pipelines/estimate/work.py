"""The work of a run, counted from settings and footage."""

from __future__ import annotations

from dataclasses import dataclass

from v3studio.pipelines.stages.inputs import Inputs
from v3studio.pipelines.stages.training.group_scheduler import groups_at_once, memory_of_group
from v3studio.pipelines.stages.training.plan import refines_cameras
from v3studio.studio.training.pruning import splats_after_pruning
from v3studio.studio.training.settings import TrainSettings


@dataclass(frozen=True)
class Work:
    """The work of a run."""

    train_cameras: int
    held_out_cameras: int
    pixels: int  # of all training images of one frame, uncropped
    groups: tuple[int, ...]  # number of frames in each group
    at_once: int  # groups that are trained in parallel
    threads: int
    points: int
    resolution: int  # voxels along the longest side of the hull
    memory_of_group: int  # bytes that training one group takes
    train: TrainSettings
    refines: bool = False  # whether cameras are refined before the groups are trained

    @classmethod
    def of(cls, inputs: Inputs) -> Work:
        """The work of a take whose cameras are known."""
        footage, config = inputs.calibrated_footage, inputs.config
        sizes = [footage.rig[name].width * footage.rig[name].height for name in footage.train_cameras]
        return cls(
            train_cameras=len(footage.train_cameras),
            held_out_cameras=len(footage.held_out_cameras),
            pixels=sum(sizes),
            groups=tuple(len(group.frames) for group in inputs.groups),
            at_once=groups_at_once(inputs),
            threads=inputs.threads,
            points=config.initialize.points,
            resolution=config.initialize.resolution,
            memory_of_group=memory_of_group(inputs),
            train=config.train,
            refines=refines_cameras(inputs.take, config.train),
        )

    @property
    def frames(self) -> int:
        """Frames of the take."""
        return sum(self.groups)

    @property
    def splats_before_pruning(self) -> int:
        """Splats of a keyframe, if none become transparent; on walk16, nearly none do."""
        train = self.train
        first = (train.densify_from // train.densify_every + 1) * train.densify_every
        grows = first < min(train.densify_until, train.keyframe_iterations + 1)
        return max(self.points, train.densify_max_splats) if grows else self.points

    @property
    def splats(self) -> int:
        """Splats of a trained frame."""
        return splats_after_pruning(self.train, self.splats_before_pruning)

    def waves(self, seconds_of_group: dict[int, float]) -> float:
        """Seconds until all groups are done, `at_once` in parallel, in order; given those by a group's frames."""
        free = [0.0] * self.at_once
        for frames in self.groups:
            free[free.index(min(free))] += seconds_of_group[frames]
        return max(free)
