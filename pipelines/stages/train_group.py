"""Trains one group: the keyframe, then frame after frame on both sides, each written at once; then all jointly."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Mapping, Sequence, Set
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from itertools import zip_longest
from pathlib import Path
from statistics import fmean
from typing import TYPE_CHECKING, Literal

from v3studio.pipelines.events.cancellation import Cancellation
from v3studio.pipelines.reports.images import render, write_image
from v3studio.pipelines.stages.camera_fit import initial_points
from v3studio.pipelines.stages.group_scheduler import run_groups, sides_at_once
from v3studio.pipelines.stages.inputs import Inputs
from v3studio.pipelines.stages.params import derived_seed
from v3studio.pipelines.stages.reporter import StageReporter
from v3studio.pipelines.stages.training_views import training_views
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
from v3studio.pipelines.takes.take import Take
from v3studio.studio.atomic_files import remove
from v3studio.studio.errors import Message
from v3studio.studio.json_types import JsonData
from v3studio.studio.progress import ProgressFn

if TYPE_CHECKING:
    from torch import Tensor

    from v3studio.studio.gaussians import Gaussians
    from v3studio.studio.training import TrainingView
    from v3studio.studio.training.refine import Refinement
    from v3studio.studio.training.settings import TrainSettings


_MANY_PIXELS, _GOOD_PIXELS = 600_000, 150_000
"""Pixels of the performer's bounding box: above the first, training on a CPU is too slow; the second works well."""

_MOTION_NETWORK, _MOTION_VIEW = 0.5, 0.75
"""Time of a step of motion in steps of keyframes or fine-tuning: that of its network, and of each view (sample capture,
quickstart with two views, 2 cores: 78 s for the 3200 steps of a keyframe, 14 s for 170 steps of motion and 250 of
fine-tuning; the network takes a quarter of a motion step)."""


Kind = Literal["keyframe", "later", "joint"]  # A keyframe, another frame, or the joint training of a group
Place = tuple[int, int]  # A group and a position in it; -1 is the group as a whole


class TrainClock:
    """Elapsed fraction of the training time. At first, frames are weighted by their number of training steps, where one
    of motion counts as several; then by measured seconds per kind of frame. Joint training counts once for each frame
    of the group. `finished`: positions of the frames trained before this run, by group index."""

    def __init__(self, groups: Sequence[Group], finished: Mapping[int, Set[int]], settings: TrainSettings) -> None:
        frames = sum(len(group.frames) - len(finished[group.index]) for group in groups)
        keyframes = sum(group.middle not in finished[group.index] for group in groups)
        joint = sum(len(group.frames) for group in groups if len(group.frames) > 1)
        self._left: dict[Kind, int] = {
            "keyframe": keyframes,
            "later": frames - keyframes,
            "joint": joint if settings.joint_iterations else 0,
        }
        # of a motion step, in steps of keyframes or fine-tuning
        motion = _MOTION_NETWORK + _MOTION_VIEW * settings.motion_views
        self._steps: dict[Kind, float] = {
            "keyframe": settings.keyframe_iterations + settings.prune_finetune_iterations,
            "later": motion * settings.motion_iterations + settings.finetune_iterations,
            "joint": settings.joint_iterations,
        }
        self._seconds: dict[Kind, list[float]] = {kind: [] for kind in self._left}
        self._current: dict[Place, tuple[Kind, float]] = {}

    def reached(self, place: Place, kind: Kind, frames: float) -> None:
        """Of what is done there, this many frames are trained (0 to 1, of joint training to all of the group)."""
        self._current[place] = (kind, frames)

    def finished(self, place: Place, kind: Kind, seconds: float, frames: int = 1) -> None:
        """Frames are trained and took `seconds` together."""
        self._seconds[kind] += [seconds / frames] * frames
        self._left[kind] -= frames
        self._current.pop(place, None)

    @property
    def fraction(self) -> float:
        """0 to 1."""
        behind = sum(len(known) * self._weight(kind) for kind, known in self._seconds.items())
        ahead = sum(left * self._weight(kind) for kind, left in self._left.items())
        for kind, frames in self._current.values():
            part = frames * self._weight(kind)
            behind, ahead = behind + part, ahead - part
        return min(1.0, behind / (behind + ahead)) if behind + ahead > 0 else 1.0

    def _weight(self, kind: Kind) -> float:
        """Seconds per frame of this kind; estimated from the other kinds until one is measured."""
        if self._seconds[kind]:
            return fmean(self._seconds[kind])
        known = [other for other, seconds in self._seconds.items() if seconds]
        if not known:
            return self._steps[kind]
        return self._steps[kind] * fmean(fmean(self._seconds[one]) / max(1, self._steps[one]) for one in known)


def before_joint(take: Take, group: Group, index: int, key: str, since: int = 0) -> Path | None:
    """The file of a frame, by its index, as it was trained alone, not jointly; None if none has `key`, or is older."""
    paths = take.trained_frame(group.index, index), take.separate_frame(group.index, index)
    return next((path for path in paths if has_key(path, key, since)), None)


def _kind(group: Group, position: int) -> Kind:
    return "keyframe" if position == group.middle else "later"


@dataclass(eq=False)
class GroupWork:
    """Trains groups; several threads may train one group each. Set `stop` to cancel all of them: they raise Cancelled.
    `written` is called with the index of a group when all of its frames are written. `readers`: cameras that are read
    in parallel."""

    inputs: Inputs
    reporter: StageReporter
    clock: TrainClock
    readers: int = 1
    written: Callable[[int], None] = lambda group: None
    stop: Cancellation = field(default_factory=Cancellation)

    def __post_init__(self) -> None:
        self.settings: TrainSettings = self.inputs.config.train
        self._lock = threading.Lock()  # guards the clock, the labels and the time of the last preview
        self._since = self.inputs.since.get("train", 0)
        self._labels: dict[Place, str] = {}
        self._outlines_off: dict[int, float | None] = {}  # of each group's keyframe, once it is trained
        self._last_preview = time.monotonic()
        self._advised = False

    def check(self) -> None:
        """Raise Cancelled if the run was cancelled, or another group failed."""
        self.stop.check()
        self.reporter.check()

    def train(self, group: Group, finished: Set[int], keys: list[str], final_keys: list[str]) -> None:
        """Train the frames of a group and write each as soon as it is finished; then train them jointly.

        The two sides of the keyframe are trained in parallel if there are threads for both. `finished`: positions of
        the frames that are trained already, not counting joint training. `keys`, `final_keys`: of each frame before and
        after joint training, see `pipelines.stages.train`; equal if there is none.
        """
        import torch

        timings = self._timings(group, finished)
        joint = keys != final_keys
        seen: dict[int, list[TrainingView]] | None = {} if joint else None
        if group.middle not in finished:
            self._train_frames(group, [group.middle], keys, timings, seen)
        sides = [[position for position in side if position not in finished] for side in group.sides]
        threads = torch.get_num_threads()
        at_once = sides_at_once(self.inputs, threads)
        jobs = {
            number: partial(self._train_frames, group, side, keys, timings, seen)
            for number, side in enumerate(sides)
            if side
        }
        run_groups(jobs, at_once, [threads // at_once] * 2, self.stop)
        if seen is not None:
            self._train_jointly(group, seen, keys, final_keys[0], timings)
        else:
            self._undo_joint(group, keys)
            self.written(group.index)

    def _train_frames(
        self,
        group: Group,
        positions: Sequence[int],
        keys: list[str],
        timings: list[float],
        seen: dict[int, list[TrainingView]] | None,
    ) -> None:
        """Train the keyframe, or frames on one side of it, in this order. `keys` and `timings` are of all frames of the
        group; those of these are entered into the latter. `seen`, if any, gets joint training's views by position."""
        last = [self._trained(group, position, keys) for position in group.trained_before(positions[0])]
        # decode the images of the next frame while this one trains
        with ThreadPoolExecutor(1, thread_name_prefix="footage") as ahead:
            views = ahead.submit(self._views, group.frames[positions[0]], tell=True)
            for position, following in zip_longest(positions, positions[1:]):
                current = views.result()
                self._advise(current)
                if seen is not None:
                    seen[position] = self._kept_views(group, position, current)
                if following is not None:
                    views = ahead.submit(self._views, group.frames[following])
                started = self.reporter.clock()
                gaussians = self._frame(group, position, last, current, keys)
                seconds = self.reporter.clock() - started
                with self._lock:
                    self.clock.finished((group.index, position), _kind(group, position), seconds)
                    self._labels.pop((group.index, position), None)
                    timings[position] = round(seconds, 3)
                    # before the frame, so that it exists whenever a frame does
                    self._write_group(group, gaussians, timings)
                index, frame = group.first + position, group.frames[position]
                path = self.inputs.take.trained_frame(group.index, index)
                write_frame(path, gaussians, self._about(group, index, keys[position]))
                remove(self.inputs.take.keyframe_checkpoint(group.index))
                values = {"index": index, "splats": len(gaussians), "seconds": round(seconds, 2)}
                self.reporter.metrics(values, group=group.index, frame=frame)
                self._preview(group, position, gaussians, None)
                last = [*last[-2:], gaussians]

    def _trained(self, group: Group, position: int, keys: list[str]) -> Gaussians:
        """A finished frame, before joint training."""
        path = before_joint(self.inputs.take, group, group.first + position, keys[position])
        return read_frame(path or self.inputs.take.trained_frame(group.index, group.first + position))

    def _kept_views(self, group: Group, position: int, views: list[TrainingView]) -> list[TrainingView]:
        """Views of a frame that joint training uses."""
        from v3studio.studio.training.joint import views_of_frame

        sizes = [self.inputs.trained_footage.rig[name] for name in self.inputs.trained_footage.train_cameras]
        pixels = sum(camera.width * camera.height for camera in sizes)
        return views_of_frame(views, pixels, len(group.frames), position)

    def _train_jointly(
        self, group: Group, seen: dict[int, list[TrainingView]], keys: list[str], key: str, timings: list[float]
    ) -> None:
        """Train all frames of a group together, from a checkpoint with the same key if there is one. `seen`: views of
        frames that this run has read already, by position; `keys`: of the frames before joint training."""
        from v3studio.studio.training import train_jointly

        take, device = self.inputs.take, self.inputs.device
        path = take.joint_checkpoint(group.index)

        def keep(step: int, state: dict[str, Tensor]) -> None:
            write_tensors(path, state, FrameMetadata(key=key, step=step, group=group.index))

        for position, frame in enumerate(group.frames):
            if position not in seen:
                seen[position] = self._kept_views(group, position, self._views(frame, tell=True))
        frames = [self._trained(group, position, keys) for position in range(len(group.frames))]
        resume = read_tensors(path, key, self._since)
        if resume is not None:
            self.reporter.log(f"group {group.index}: resuming joint training at step {int(resume['done'])}")
        started = self.reporter.clock()
        trained = train_jointly(
            [frame.to(device) for frame in frames],
            [seen[position] for position in range(len(frames))],
            self.settings,
            keyframe_off=self._outlines_off[group.index],
            seed=derived_seed(self.inputs.config.run.seed, "train", group.index, "joint"),
            progress=self._reporting((group.index, -1), "joint", f"group {group.index}", len(frames), {}),
            checkpoint=keep,
            resume=resume,
        )
        seconds = self.reporter.clock() - started
        with self._lock:
            self.clock.finished((group.index, -1), "joint", seconds, len(frames))
            self._labels.pop((group.index, -1), None)
        # first all of these, since a run that is killed among the others needs them
        for index, before, own in zip(group.indices, frames, keys, strict=True):
            if not has_key(take.separate_frame(group.index, index), own, self._since):
                write_frame(take.separate_frame(group.index, index), before, self._about(group, index, own))
        self._write_group(group, trained[0], timings, round(seconds, 3))
        for index, gaussians in zip(group.indices, trained, strict=True):
            write_frame(take.trained_frame(group.index, index), gaussians.to("cpu"), self._about(group, index, key))
        remove(path)
        self.reporter.log(f"group {group.index}: {len(frames)} frames trained jointly in {seconds:.1f} s")
        self.written(group.index)

    def _undo_joint(self, group: Group, keys: list[str]) -> None:
        """Bring back frames that were trained jointly before."""
        take = self.inputs.take
        for index, key in zip(group.indices, keys, strict=True):
            path = before_joint(take, group, index, key)
            if path == take.separate_frame(group.index, index):
                write_frame(take.trained_frame(group.index, index), read_frame(path), self._about(group, index, key))

    def _frame(
        self, group: Group, position: int, last: list[Gaussians], views: list[TrainingView], keys: list[str]
    ) -> Gaussians:
        """Train a frame; `last`: up to three frames that were trained before it, the latest last."""
        from v3studio.studio.training import train_interframe

        device = self.inputs.device
        seed = derived_seed(self.inputs.config.run.seed, "train", group.index, position)

        def snapshot(iteration: int, gaussians: Gaussians) -> None:
            self._preview(group, position, gaussians, iteration)

        if not last:
            return self._keyframe(group, views, keys[position], seed, snapshot)
        previous, *earlier = [frame.to(device) for frame in reversed(last)]
        gaussians = train_interframe(
            previous,
            views,
            self.settings,
            before_previous=earlier[0] if earlier else None,
            third_last=earlier[1] if len(earlier) > 1 else None,
            keyframe_off=self._outlines_off[group.index],
            seed=seed,
            progress=self._progress(group, position),
            snapshot=snapshot,
        )
        return gaussians.to("cpu")

    def _keyframe(
        self, group: Group, views: list[TrainingView], key: str, seed: int, snapshot: Callable[[int, Gaussians], None]
    ) -> Gaussians:
        """Train the keyframe, from a checkpoint with the same key if there is one."""
        from v3studio.studio.training import train_keyframe

        path = self.inputs.take.keyframe_checkpoint(group.index)

        def keep(step: int, state: dict[str, Tensor]) -> None:
            path.parent.mkdir(parents=True, exist_ok=True)
            write_tensors(path, state, FrameMetadata(key=key, step=step, frame=group.keyframe))

        resume = read_tensors(path, key, self._since)
        if resume is not None:
            self.reporter.log(f"group {group.index}: resuming the keyframe at step {int(resume['done'])}")
        gaussians = train_keyframe(
            views,
            *initial_points(self.inputs, group),
            self.settings,
            seed=seed,
            progress=self._progress(group, group.middle),
            snapshot=snapshot,
            checkpoint=keep,
            resume=resume,
            compared=lambda refinement: self._tell_outlines(group, refinement),
        )
        return gaussians.to("cpu")

    def _tell_outlines(self, group: Group, refinement: Refinement) -> None:
        """Keep and report what the keyframe shows about the masks."""
        self._outlines_off[group.index] = refinement.off
        if refinement.off is not None:
            done = "are refined" if refinement.refined else "stay as they are"
            siting = ", chroma is subsampled as in the footage" if refinement.chroma_shift is not None else ""
            self.reporter.log(
                f"group {group.index}: {refinement.off:.1f}% of the mask outlines are more than a pixel from those of "
                f"the splats: masks {done}{siting}"
            )

    def _progress(self, group: Group, position: int) -> ProgressFn:
        """Progress callback for a frame."""
        where: dict[str, JsonData] = {"frame": group.frames[position], "index": group.first + position}
        place, words = (group.index, position), f"group {group.index}, frame {group.frames[position]}"
        return self._reporting(place, _kind(group, position), words, 1, where)

    def _reporting(self, place: Place, kind: Kind, words: str, frames: int, where: dict[str, JsonData]) -> ProgressFn:
        kept: dict[str, JsonData] = {}  # loss and psnr come every few steps; repeat them for the steps in between

        def tell(done: int, total: int, **figures: JsonData) -> None:
            self.stop.check()
            phase = figures.pop("phase", "keyframe")
            kept.update(figures)
            with self._lock:
                self.clock.reached(place, kind, frames * done / total if total else 0.0)
                self._labels[place] = f"{words}: {phase}"
                fraction, label = self.clock.fraction, "; ".join(self._labels[key] for key in sorted(self._labels))
            self.reporter.progress(
                fraction, label, iteration=done, iterations=total, phase=phase, group=place[0], **where, **kept
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

        return training_views(self.inputs, self.reporter, frame, reading, self.readers)

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
            problem = (
                f"the performer covers {pixels / 1e6:.1f} megapixels per image and there is no GPU: training is "
                f"about {pixels / _GOOD_PIXELS:.0f} times slower than with capture.scale = {better:g}"
            )
            fields = {"setting": "capture.scale", "pixels": pixels, "suggested": better}
            self.reporter.warn(Message("training.slow", problem, fields=fields))

    def _timings(self, group: Group, finished: Set[int]) -> list[float]:
        """Training time of each frame; 0 where unknown, or not finished. Also what the keyframe showed, if finished."""
        path = self.inputs.take.train_group(group.index) / "group.json"
        before = read_model(path, TrainedGroup) if path.is_file() else None
        known = () if before is None else before.seconds[: len(group.frames)]
        self._outlines_off[group.index] = before.outlines_off if before is not None and finished else None
        pairs = zip_longest(group.frames, known, fillvalue=0.0)
        return [seconds if position in finished else 0.0 for position, (_, seconds) in enumerate(pairs)]

    def _about(self, group: Group, index: int, key: str) -> FrameMetadata:
        return FrameMetadata(key=key, group=group.index, index=index, frame=group.frames[index - group.first])

    def _write_group(
        self, group: Group, gaussians: Gaussians, timings: list[float], joint_seconds: float = 0.0
    ) -> None:
        folder = self.inputs.take.train_group(group.index)
        folder.mkdir(parents=True, exist_ok=True)
        self.inputs.take.forget("train")
        write_model(
            folder / "group.json",
            TrainedGroup(
                group=group.index,
                first=group.first,
                frames=tuple(int(frame) for frame in group.frames),
                splats=len(gaussians),
                sh_degree=gaussians.sh_degree,
                outlines_off=self._outlines_off[group.index],
                seconds=tuple(timings),
                joint_seconds=joint_seconds,
            ),
        )

    def _preview(self, group: Group, position: int, gaussians: Gaussians, iteration: int | None) -> None:
        """Render a preview from the first held-out camera (or training camera), at most every run.preview_seconds."""
        pause = self.inputs.config.run.preview_seconds
        with self._lock:
            if pause == 0 or time.monotonic() - self._last_preview < pause:
                return
            self._last_preview = time.monotonic()
        footage = self.inputs.trained_footage
        camera = (*footage.held_out_cameras, *footage.train_cameras)[0]
        frame = group.frames[position]
        image = render(
            gaussians, footage.rig[camera], self.inputs.config.evaluate.background, self.inputs.device, width=640
        )
        name = f"{group.first + position:06d}{'' if iteration is None else f'_{iteration:06d}'}.png"
        path = self.inputs.take.previews / name
        write_image(path, image)
        self.reporter.preview(
            path, f"frame {frame}, {camera}", camera=camera, group=group.index, frame=frame, iteration=iteration
        )
