"""Trains one group: the keyframe, then frame after frame on both sides, each written at once; then all jointly."""

from __future__ import annotations

import math
import threading
from collections.abc import Mapping, Sequence, Set
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from itertools import zip_longest
from pathlib import Path
from statistics import median_high
from typing import TYPE_CHECKING

from v3studio.pipelines.stages.params import derived_seed
from v3studio.pipelines.stages.reporter import StageReporter
from v3studio.pipelines.stages.training.camera_fit import initial_points
from v3studio.pipelines.stages.training.group_scheduler import run_groups
from v3studio.pipelines.stages.training.plan import TrainPlan
from v3studio.pipelines.stages.training.progress import WHOLE, Previews, TrainProgress
from v3studio.pipelines.stages.training.views import ViewReader
from v3studio.pipelines.takes.files.json_files import read_model, write_model
from v3studio.pipelines.takes.frames.frame_files import (
    FrameMetadata,
    has_key,
    read_frame,
    read_tensors,
    write_frame,
    write_tensors,
)
from v3studio.pipelines.takes.frames.groups import Group
from v3studio.pipelines.takes.results.stage_files import TrainedGroup
from v3studio.studio.atomic_files import remove
from v3studio.studio.errors import Message

if TYPE_CHECKING:
    from torch import Tensor

    from v3studio.studio.gaussians import Gaussians
    from v3studio.studio.training import TrainingView
    from v3studio.studio.training.refine import Refinement
    from v3studio.studio.training.settings import TrainSettings

_MANY_PIXELS, _GOOD_PIXELS = 600_000, 150_000
"""Pixels of the performer's bounding box: above the first, training on a CPU is too slow; the second works well."""

Seen = dict[int, list["TrainingView"]]  # the views of frames that joint training uses, by position in the group


@dataclass(frozen=True, eq=False)
class GroupJob:
    """A group to train, and with what. `keys`: of its frames before joint training; `trained`: positions of the frames
    that are trained already, not counting joint training; `readers`: cameras that are read in parallel;
    `sides_at_once`: 2 to train both sides of the keyframe in parallel."""

    plan: TrainPlan
    group: Group
    keys: list[str]
    trained: Set[int]
    views: ViewReader
    previews: Previews
    readers: int
    sides_at_once: int

    @property
    def settings(self) -> TrainSettings:
        return self.views.settings

    @property
    def device(self) -> str:
        return self.views.device

    def seed_of(self, what: int | str) -> int:
        """The seed of a frame by its position, or of "joint" training."""
        return derived_seed(self.plan.seed, "train", self.group.index, what)

    def frame_path(self, position: int) -> Path:
        return self.plan.take.trained_frame(self.group.index, self.group.first + position)

    def separate_path(self, position: int) -> Path:
        return self.plan.take.separate_frame(self.group.index, self.group.first + position)

    def before_joint(self, position: int) -> Path:
        """The file of a trained frame as it was trained alone, not jointly."""
        return self.plan.before_joint(self.group, position, self.keys[position]) or self.separate_path(position)

    def about(self, position: int, key: str) -> FrameMetadata:
        group = self.group
        return FrameMetadata(key=key, group=group.index, index=group.first + position, frame=group.frames[position])


def train_group(job: GroupJob, progress: TrainProgress) -> None:
    """Train the frames of a group and write each as soon as it is finished; then train them jointly.

    The two sides of the keyframe are trained in parallel if `sides_at_once` is 2. Raises Cancelled; StudioError if the
    footage cannot be read.
    """
    import torch

    group, report = job.group, GroupReport(job)
    seen: Seen | None = {} if job.keys != job.plan.final_keys(job.keys) else None
    if group.middle not in job.trained:
        _train_frames(job, report, [group.middle], progress, seen)
    sides = [[position for position in side if position not in job.trained] for side in group.sides]
    threads = torch.get_num_threads()
    at_once = min(job.sides_at_once, threads)
    jobs = {
        number: partial(_train_frames, job, report, side, progress, seen) for number, side in enumerate(sides) if side
    }
    run_groups(jobs, at_once, [threads // at_once] * 2, progress.stop)
    if seen is not None:
        _train_jointly(job, report, progress, seen)
    else:
        _undo_joint(job)


class GroupReport:
    """The group's file `group.json`: training time in seconds of each frame, 0 where unknown, or not finished; and what
    the keyframe shows about the masks. Thread-safe."""

    def __init__(self, job: GroupJob) -> None:
        self._job, self._lock = job, threading.Lock()
        self._path = job.plan.take.train_group(job.group.index) / "group.json"
        before = read_model(self._path, TrainedGroup) if self._path.is_file() else None
        known = () if before is None else before.seconds[: len(job.group.frames)]
        pairs = zip_longest(job.group.frames, known, fillvalue=0.0)
        self._seconds = [seconds if at in job.trained else 0.0 for at, (_, seconds) in enumerate(pairs)]
        self.outlines_off = before.outlines_off if before is not None and job.trained else None

    def write(self, gaussians: Gaussians, seconds: Mapping[int, float]) -> None:
        """Write the file, before the frames, so that it exists whenever a frame does. `seconds`: new ones, by position;
        `WHOLE`: of joint training."""
        group = self._job.group
        with self._lock:
            for position, value in seconds.items():
                if position != WHOLE:
                    self._seconds[position] = round(value, 3)
            report = TrainedGroup(
                group=group.index,
                first=group.first,
                frames=tuple(int(frame) for frame in group.frames),
                splats=len(gaussians),
                sh_degree=gaussians.sh_degree,
                outlines_off=self.outlines_off,
                seconds=tuple(self._seconds),
                joint_seconds=round(seconds.get(WHOLE, 0.0), 3),
            )
            self._path.parent.mkdir(parents=True, exist_ok=True)
            self._job.plan.take.forget("train")
            write_model(self._path, report)


def _train_frames(
    job: GroupJob, report: GroupReport, positions: Sequence[int], progress: TrainProgress, seen: Seen | None
) -> None:
    """Train the keyframe, or frames on one side of it, in this order. `seen`, if any, gets joint training's views."""
    group, reporter = job.group, progress.reporter
    last = [read_frame(job.before_joint(position)) for position in group.trained_before(positions[0])]
    # decode the images of the next frame while this one trains
    with ThreadPoolExecutor(1, thread_name_prefix="footage") as ahead:
        views = ahead.submit(_read_views, job, positions[0], progress, tell=True)
        for position, following in zip_longest(positions, positions[1:]):
            current = views.result()
            _advise_scale(current, job, reporter)
            if seen is not None:
                seen[position] = _kept_views(job, position, current)
            if following is not None:
                views = ahead.submit(_read_views, job, following, progress)
            started = reporter.clock()
            if last:
                gaussians = _later_frame(job, report, position, last, current, progress)
            else:
                gaussians = _keyframe(job, report, current, progress)
            seconds = reporter.clock() - started
            progress.finished(group, position, seconds)
            report.write(gaussians, {position: seconds})
            write_frame(job.frame_path(position), gaussians, job.about(position, job.keys[position]))
            remove(job.plan.take.keyframe_checkpoint(group.index))
            index, frame = group.first + position, group.frames[position]
            figures = {"index": index, "splats": len(gaussians), "seconds": round(seconds, 2)}
            reporter.metrics(figures, group=group.index, frame=frame)
            job.previews.show(gaussians, group, position)
            last = [*last[-2:], gaussians]


def _read_views(job: GroupJob, position: int, progress: TrainProgress, tell: bool = False) -> list[TrainingView]:
    """Training views of a frame; `tell`: report progress while reading them."""
    frame = job.group.frames[position]
    return job.views.views(frame, progress.reporter, progress.reading(frame, tell), job.readers)


def _kept_views(job: GroupJob, position: int, views: list[TrainingView]) -> list[TrainingView]:
    """Views of a frame that joint training uses."""
    from v3studio.studio.training.joint import views_of_frame

    footage = job.views.footage
    sizes = [footage.rig[name] for name in footage.train_cameras]
    pixels = sum(camera.width * camera.height for camera in sizes)
    return views_of_frame(views, pixels, len(job.group.frames), position)


def _keyframe(job: GroupJob, report: GroupReport, views: list[TrainingView], progress: TrainProgress) -> Gaussians:
    """Train the keyframe, from a checkpoint with the same key if there is one."""
    from v3studio.studio.training import train_keyframe

    group, reporter = job.group, progress.reporter
    path, key = job.plan.take.keyframe_checkpoint(group.index), job.keys[group.middle]

    def keep(step: int, state: dict[str, Tensor]) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_tensors(path, state, FrameMetadata(key=key, step=step, frame=group.keyframe))

    def compared(refinement: Refinement) -> None:
        report.outlines_off = refinement.off
        _tell_outlines(group, refinement, reporter)

    resume = read_tensors(path, key, job.plan.since)
    if resume is not None:
        reporter.log(f"group {group.index}: resuming the keyframe at step {int(resume['done'])}")
    gaussians = train_keyframe(
        views,
        *initial_points(job.plan.take, group, job.device),
        job.settings,
        seed=job.seed_of(group.middle),
        progress=progress.training(group, group.middle),
        snapshot=lambda step, gaussians: job.previews.show(gaussians, group, group.middle, step),
        checkpoint=keep,
        resume=resume,
        compared=compared,
    )
    return gaussians.to("cpu")


def _later_frame(
    job: GroupJob,
    report: GroupReport,
    position: int,
    last: Sequence[Gaussians],
    views: list[TrainingView],
    progress: TrainProgress,
) -> Gaussians:
    """Train a frame from up to three that were trained before it, the latest last."""
    from v3studio.studio.training import train_interframe

    previous, *earlier = [frame.to(job.device) for frame in reversed(last)]
    gaussians = train_interframe(
        previous,
        views,
        job.settings,
        before_previous=earlier[0] if earlier else None,
        third_last=earlier[1] if len(earlier) > 1 else None,
        keyframe_off=report.outlines_off,
        seed=job.seed_of(position),
        progress=progress.training(job.group, position),
        snapshot=lambda step, gaussians: job.previews.show(gaussians, job.group, position, step),
    )
    return gaussians.to("cpu")


def _train_jointly(job: GroupJob, report: GroupReport, progress: TrainProgress, seen: Seen) -> None:
    """Train all frames of a group together, from a checkpoint with the same key if there is one. `seen`: the views of
    frames that this run has read already."""
    from v3studio.studio.training import train_jointly

    group, reporter, key = job.group, progress.reporter, job.plan.final_keys(job.keys)[0]
    path = job.plan.take.joint_checkpoint(group.index)

    def keep(step: int, state: dict[str, Tensor]) -> None:
        write_tensors(path, state, FrameMetadata(key=key, step=step, group=group.index))

    positions = range(len(group.frames))
    for position in positions:
        if position not in seen:
            seen[position] = _kept_views(job, position, _read_views(job, position, progress, tell=True))
    frames = [read_frame(job.before_joint(position)) for position in positions]
    resume = read_tensors(path, key, job.plan.since)
    if resume is not None:
        reporter.log(f"group {group.index}: resuming joint training at step {int(resume['done'])}")
    started = reporter.clock()
    trained = train_jointly(
        [frame.to(job.device) for frame in frames],
        [seen[position] for position in positions],
        job.settings,
        keyframe_off=report.outlines_off,
        seed=job.seed_of("joint"),
        progress=progress.training(group, WHOLE),
        checkpoint=keep,
        resume=resume,
    )
    seconds = reporter.clock() - started
    progress.finished(group, WHOLE, seconds)
    # first all of these, since a run that is killed among the others needs them
    for position, before, own in zip(positions, frames, job.keys, strict=True):
        if not has_key(job.separate_path(position), own, job.plan.since):
            write_frame(job.separate_path(position), before, job.about(position, own))
    report.write(trained[0], {WHOLE: seconds})
    for position, gaussians in zip(positions, trained, strict=True):
        write_frame(job.frame_path(position), gaussians.to("cpu"), job.about(position, key))
    remove(path)
    reporter.log(f"group {group.index}: {len(frames)} frames trained jointly in {seconds:.1f} s")


def _undo_joint(job: GroupJob) -> None:
    """Bring back frames that were trained jointly before."""
    for position, key in enumerate(job.keys):
        path = job.before_joint(position)
        if path == job.separate_path(position):
            write_frame(job.frame_path(position), read_frame(path), job.about(position, key))


def _tell_outlines(group: Group, refinement: Refinement, reporter: StageReporter) -> None:
    """Report what the keyframe shows about the masks."""
    if refinement.off is not None:
        done = "are refined" if refinement.refined else "stay as they are"
        siting = ", chroma is subsampled as in the footage" if refinement.chroma_shift is not None else ""
        reporter.log(
            f"group {group.index}: {refinement.off:.1f}% of the mask outlines are more than a pixel from those of "
            f"the splats: masks {done}{siting}"
        )


def _advise_scale(views: Sequence[TrainingView], job: GroupJob, reporter: StageReporter) -> None:
    """Warn once if the images are too large to train on without a GPU."""
    pixels = median_high(view.camera.width * view.camera.height for view in views)
    if job.device != "cpu" or pixels <= _MANY_PIXELS:
        return
    better = max(0.01, math.floor(100 * job.views.scale * math.sqrt(_GOOD_PIXELS / pixels)) / 100)
    problem = (
        f"the performer covers {pixels / 1e6:.1f} megapixels per image and there is no GPU: training is "
        f"about {pixels / _GOOD_PIXELS:.0f} times slower than with capture.scale = {better:g}"
    )
    fields = {"setting": "capture.scale", "pixels": pixels, "suggested": better}
    reporter.warn(Message("training.slow", problem, fields=fields), once=True)
