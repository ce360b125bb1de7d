"""Trains one group: the keyframe, then frame after frame; each is written as soon as it is finished."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TYPE_CHECKING

from pipelines.events.cancellation import Cancellation
from pipelines.reports.images import render, write_image
from pipelines.stages.inputs import Inputs
from pipelines.stages.params import derived_seed
from pipelines.stages.reporter import StageReporter
from pipelines.stages.training_views import training_views
from pipelines.takes.atomic_files import read_model, remove, write_model
from pipelines.takes.frame_files import FrameMetadata, read_frame, read_tensors, write_frame, write_tensors
from pipelines.takes.groups import Group
from pipelines.takes.point_files import read_points
from pipelines.takes.stage_files import TrainedGroup
from studio.errors import Message
from studio.json_types import JsonData
from studio.progress import ProgressFn

if TYPE_CHECKING:
    from studio.gaussians import Gaussians
    from studio.training import TrainingView
    from studio.training.settings import TrainSettings


_MANY_PIXELS, _GOOD_PIXELS = 600_000, 150_000
"""Pixels of the performer's bounding box: above the first, training on a CPU is too slow; the second works well."""

_MOTION_NETWORK, _MOTION_VIEW = 0.5, 0.75
"""Time of a step of motion in steps of keyframes or fine-tuning: that of its network, and of each view (sample capture,
quickstart with two views, 2 cores: 78 s for the 3200 steps of a keyframe, 14 s for 170 steps of motion and 250 of
fine-tuning; the network takes a quarter of a motion step, docs/measurements/training.md)."""


class TrainClock:
    """Elapsed fraction of the training time.

    At first, frames are weighted by their number of training steps, where one of motion counts as several; then by
    measured seconds per kind of frame (keyframe or other).

    Args:
        groups: all groups of the take.
        finished: number of frames trained before this run, by group index.
        settings: training settings.
    """

    def __init__(self, groups: Sequence[Group], finished: Mapping[int, int], settings: TrainSettings) -> None:
        todo = [position for group in groups for position in range(finished[group.index], len(group.frames))]
        self._left = {True: todo.count(0), False: len(todo) - todo.count(0)}
        # of a motion step, in steps of keyframes or fine-tuning
        motion = _MOTION_NETWORK + _MOTION_VIEW * settings.motion_views
        self._steps = {
            True: settings.keyframe_iterations + settings.prune_finetune_iterations,
            False: motion * settings.motion_iterations + settings.finetune_iterations,
        }
        self._seconds: dict[bool, list[float]] = {True: [], False: []}
        self._current: dict[int, tuple[bool, float]] = {}

    def reached(self, group: Group, position: int, share: float) -> None:
        """The fraction `share` (0 to 1) of the group's frame `position` is trained."""
        self._current[group.index] = (position == 0, share)

    def finished(self, group: Group, position: int, seconds: float) -> None:
        """Frame `position` of the group is trained and took `seconds`."""
        kind = position == 0
        self._seconds[kind].append(seconds)
        self._left[kind] -= 1
        self._current.pop(group.index, None)

    @property
    def fraction(self) -> float:
        """0 to 1."""
        behind = sum(len(self._seconds[kind]) * self._weight(kind) for kind in (True, False))
        ahead = sum(self._left[kind] * self._weight(kind) for kind in (True, False))
        for kind, share in self._current.values():
            part = share * self._weight(kind)
            behind, ahead = behind + part, ahead - part
        return min(1.0, behind / (behind + ahead)) if behind + ahead > 0 else 1.0

    def _weight(self, kind: bool) -> float:
        """Seconds per frame of this kind; estimated from the other kind until one is measured."""
        if self._seconds[kind]:
            return sum(self._seconds[kind]) / len(self._seconds[kind])
        other = self._seconds[not kind]
        if other:
            return self._steps[kind] * (sum(other) / len(other)) / max(1, self._steps[not kind])
        return float(self._steps[kind])


class GroupWork:
    """Trains groups; several threads may train one group each.

    Args:
        inputs: what the stage reads.
        reporter: of the stage.
        clock: progress of all groups together.
        readers: threads that read the images of a frame, per group.
        written: called with the index of a group and the number of its finished frames, after each frame.

    Attributes:
        stop: set it to cancel all groups; they raise Cancelled.
    """

    def __init__(
        self,
        inputs: Inputs,
        reporter: StageReporter,
        clock: TrainClock,
        readers: int = 1,
        written: Callable[[int, int], None] = lambda group, frames: None,
    ) -> None:
        self.inputs, self.reporter, self.clock, self._written = inputs, reporter, clock, written
        self._readers = readers
        self.settings: TrainSettings = inputs.config.train
        self.stop = Cancellation()
        self._lock = threading.Lock()  # guards the clock, the labels and the time of the last preview
        self._labels: dict[int, str] = {}
        self._last_preview = time.monotonic()
        self._advised = False

    def check(self) -> None:
        """Raise Cancelled if the run was cancelled, or another group failed."""
        self.stop.check()
        self.reporter.check()

    def train(self, group: Group, finished: int, keys: list[str]) -> None:
        """Train the frames of a group and write each as soon as it is finished.

        Args:
            group: the group.
            finished: number of frames that are trained already.
            keys: key of each frame, see `pipelines.stages.train`.

        Raises:
            StudioError: unusable footage, or training diverged.
            Cancelled: the run was cancelled.
        """
        take = self.inputs.take
        timings = self._timings(group, finished)
        previous = read_frame(take.trained_frame(group.index, group.first + finished - 1)) if finished else None
        before = read_frame(take.trained_frame(group.index, group.first + finished - 2)) if finished > 1 else None
        third = read_frame(take.trained_frame(group.index, group.first + finished - 3)) if finished > 2 else None
        # decode the images of the next frame while this one trains
        with ThreadPoolExecutor(1, thread_name_prefix="footage") as ahead:
            views: Future[list[TrainingView]] = ahead.submit(self._views, group.frames[finished], tell=True)
            for position in range(finished, len(group.frames)):
                current = views.result()
                self._advise(current)
                if position + 1 < len(group.frames):
                    views = ahead.submit(self._views, group.frames[position + 1])
                started = self.reporter.clock()
                gaussians = self._frame(group, position, previous, before, third, current, keys)
                seconds = self.reporter.clock() - started
                with self._lock:
                    self.clock.finished(group, position, seconds)
                    self._labels.pop(group.index, None)
                timings.append(round(seconds, 3))
                self._write(group, position, gaussians, keys[position], timings)
                self._written(group.index, position + 1)
                self._tell(group, position, gaussians, seconds)
                previous, before, third = gaussians, previous, before

    def _frame(
        self,
        group: Group,
        position: int,
        previous: Gaussians | None,
        before: Gaussians | None,
        third: Gaussians | None,
        views: list[TrainingView],
        keys: list[str],
    ) -> Gaussians:
        from studio.training import train_interframe

        device = self.inputs.device
        seed = derived_seed(self.inputs.config.run.seed, "train", group.index, position)

        def snapshot(iteration: int, gaussians: Gaussians) -> None:
            self._preview(group, position, gaussians, iteration)

        if previous is None:
            return self._keyframe(group, views, keys[0], seed, snapshot)
        found = train_interframe(
            previous.to(device),
            views,
            self.settings,
            before_previous=None if before is None else before.to(device),
            third_last=None if third is None else third.to(device),
            seed=seed,
            progress=self._progress(group, position),
            snapshot=snapshot,
        )
        return found.gaussians.detach().to("cpu")

    def _keyframe(
        self, group: Group, views: list[TrainingView], key: str, seed: int, snapshot: Callable[[int, Gaussians], None]
    ) -> Gaussians:
        """Train the keyframe, from a checkpoint with the same key if there is one."""
        import torch

        from studio.training import train_keyframe

        take, device = self.inputs.take, self.inputs.device
        path = take.keyframe_checkpoint(group.index)

        def keep(step: int, state: dict[str, torch.Tensor]) -> None:
            path.parent.mkdir(parents=True, exist_ok=True)
            write_tensors(path, state, FrameMetadata(key=key, step=step, frame=group.keyframe))

        resume = read_tensors(path, key)
        if resume is not None:
            self.reporter.log(f"group {group.index}: resuming the keyframe at step {int(resume['done'])}")
        points, colors = read_points(take.initialize_group(group.index) / "points.ply")
        gaussians = train_keyframe(
            views,
            torch.from_numpy(points).to(device),
            torch.from_numpy(colors).to(device),
            self.settings,
            seed=seed,
            progress=self._progress(group, 0),
            snapshot=snapshot,
            checkpoint=keep,
            resume=resume,
        )
        return gaussians.detach().to("cpu")

    def _progress(self, group: Group, position: int) -> ProgressFn:
        """Progress callback for a frame."""
        frame = group.frames[position]
        where = f"group {group.index}, frame {frame}"
        kept: dict[str, JsonData] = {}  # loss and psnr come every few steps; repeat them for the steps in between

        def tell(done: int, total: int, **figures: JsonData) -> None:
            self.stop.check()
            phase = figures.pop("phase", "keyframe")
            kept.update(figures)
            with self._lock:
                self.clock.reached(group, position, done / total if total else 0.0)
                self._labels[group.index] = f"{where}: {phase}"
                fraction, label = self.clock.fraction, "; ".join(self._labels[key] for key in sorted(self._labels))
            self.reporter.progress(
                fraction,
                label,
                iteration=done,
                iterations=total,
                phase=phase,
                group=group.index,
                frame=frame,
                index=group.first + position,
                **kept,
            )

        return tell

    def _views(self, frame: int, tell: bool = False) -> list[TrainingView]:
        """Training views of a frame; `tell`: report progress while reading them."""

        def reading(number: int, images: int) -> None:
            self.stop.check()
            if tell:
                with self._lock:
                    fraction = self.clock.fraction
                self.reporter.progress(fraction, f"reading frame {frame}: image {number} of {images}")

        return training_views(self.inputs, self.reporter, frame, reading, self._readers)

    def _advise(self, views: list[TrainingView]) -> None:
        """Without a GPU, warn once if the images are too large to train on."""
        with self._lock:
            if self._advised or self.inputs.device != "cpu":
                return
            self._advised = True
        pixels = sorted(view.camera.width * view.camera.height for view in views)[len(views) // 2]
        if pixels > _MANY_PIXELS:
            scale = self.inputs.config.capture.scale
            better = max(0.01, math.floor(100 * scale * math.sqrt(_GOOD_PIXELS / pixels)) / 100)
            self.reporter.warn(
                Message(
                    "training.slow",
                    f"the performer covers {pixels / 1e6:.1f} megapixels per image and there is no GPU: training is "
                    f"about {pixels / _GOOD_PIXELS:.0f} times slower than with capture.scale = {better:g}",
                    fields={"setting": "capture.scale", "pixels": pixels, "suggested": better},
                )
            )

    def _timings(self, group: Group, finished: int) -> list[float]:
        """Training time of the finished frames; 0 where unknown."""
        path = self.inputs.take.train_group(group.index) / "group.json"
        known = read_model(path, TrainedGroup).seconds if path.is_file() else ()
        return [*known[:finished], *[0.0] * (finished - len(known))]

    def _write(self, group: Group, position: int, gaussians: Gaussians, key: str, timings: list[float]) -> None:
        take = self.inputs.take
        about = FrameMetadata(key=key, group=group.index, index=group.first + position, frame=group.frames[position])
        folder = take.train_group(group.index)
        folder.mkdir(parents=True, exist_ok=True)
        # group.json first, so that it exists whenever the frame does; it may be one frame ahead
        write_model(
            folder / "group.json",
            TrainedGroup(
                group=group.index,
                first=group.first,
                frames=tuple(int(frame) for frame in group.frames),
                splats=len(gaussians),
                sh_degree=gaussians.sh_degree,
                seconds=tuple(timings),
            ),
        )
        write_frame(take.trained_frame(group.index, group.first + position), gaussians, about)
        remove(take.keyframe_checkpoint(group.index))

    def _tell(self, group: Group, position: int, gaussians: Gaussians, seconds: float) -> None:
        frame = group.frames[position]
        values = {"index": group.first + position, "splats": len(gaussians), "seconds": round(seconds, 2)}
        self.reporter.metrics(values, group=group.index, frame=frame)
        self._preview(group, position, gaussians, None)

    def _preview(self, group: Group, position: int, gaussians: Gaussians, iteration: int | None) -> None:
        """Render a preview from the first held-out camera (or training camera), at most every run.preview_seconds."""
        pause = self.inputs.config.run.preview_seconds
        with self._lock:
            if pause == 0 or time.monotonic() - self._last_preview < pause:
                return
            self._last_preview = time.monotonic()
        footage = self.inputs.footage.trained
        camera = (*footage.held_out_cameras, *footage.train_cameras)[0]
        frame = group.frames[position]
        image = render(
            gaussians, footage.rig[camera], self.inputs.config.evaluate.background, self.inputs.device, width=640
        )
        name = f"{group.first + position:06d}{'' if iteration is None else f'_{iteration:06d}'}.png"
        path = self.inputs.take.previews / name
        write_image(path, image)
        self.reporter.preview(
            path,
            f"frame {frame}, {camera}",
            camera=camera,
            group=group.index,
            frame=frame,
            iteration=iteration,
        )
