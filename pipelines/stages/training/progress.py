"""Progress of groups that are trained in parallel, and previews of their frames."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping, Sequence, Set
from statistics import fmean
from typing import TYPE_CHECKING, Literal

from v3studio.pipelines.events.cancellation import Cancellation
from v3studio.pipelines.reports.images import render, write_image
from v3studio.pipelines.stages.reporter import StageReporter
from v3studio.pipelines.takes.frames.groups import Group
from v3studio.studio.json_types import JsonData
from v3studio.studio.progress import ProgressFn

if TYPE_CHECKING:
    from pathlib import Path

    from v3studio.studio.footage import Footage
    from v3studio.studio.gaussians import Gaussians
    from v3studio.studio.training.settings import TrainSettings

_MOTION_NETWORK, _MOTION_VIEW = 0.5, 0.75
"""Time of a step of motion in steps of keyframes or fine-tuning: that of its network, and of each view (sample capture,
quickstart with two views, 2 cores: 78 s for the 3200 steps of a keyframe, 14 s for 170 steps of motion and 250 of
fine-tuning; the network takes a quarter of a motion step)."""

Kind = Literal["keyframe", "later", "joint"]  # A keyframe, another frame, or the joint training of a group
Place = tuple[int, int]  # A group and a position in it; -1 is the group as a whole

WHOLE = -1


def kind_of(group: Group, position: int) -> Kind:
    """The kind of a frame."""
    return "keyframe" if position == group.middle else "later"


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
        """Note how much is trained at a place: 0 to 1 frames, or with joint training 0 to all of the group."""
        self._current[place] = (kind, frames)

    def finished(self, place: Place, kind: Kind, seconds: float, frames: int = 1) -> None:
        """Note that frames are trained and took `seconds` together."""
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
        return self._steps[kind] * fmean(fmean(self._seconds[other]) / max(1, self._steps[other]) for other in known)


class TrainProgress:
    """Progress of frames that are trained in parallel, as one line. Thread-safe. Set `stop` to cancel them all."""

    def __init__(self, reporter: StageReporter, clock: TrainClock) -> None:
        self.reporter, self.stop = reporter, Cancellation()
        self._clock = clock
        self._lock = threading.Lock()  # guards the clock and the labels
        self._labels: dict[Place, str] = {}

    def check(self) -> None:
        """Raise Cancelled if the run was cancelled, or another group failed."""
        self.stop.check()
        self.reporter.check()

    def reading(self, frame: int, tell: bool) -> Callable[[int, int], None]:
        """A callback before each image of a frame is read; `tell`: report progress."""

        def report(number: int, images: int) -> None:
            self.stop.check()
            if tell:
                with self._lock:
                    fraction = self._clock.fraction
                self.reporter.progress(fraction, f"reading frame {frame}: image {number} of {images}")

        return report

    def training(self, group: Group, position: int) -> ProgressFn:
        """A progress callback for a frame, or for `WHOLE`: the joint training of the group."""
        if position == WHOLE:
            return self._callback(group, WHOLE, "joint", len(group.frames), f"group {group.index}", {})
        frame = group.frames[position]
        where: dict[str, JsonData] = {"frame": frame, "index": group.first + position}
        kind, words = kind_of(group, position), f"group {group.index}, frame {frame}"
        return self._callback(group, position, kind, 1, words, where)

    def _callback(
        self, group: Group, position: int, kind: Kind, frames: int, words: str, where: dict[str, JsonData]
    ) -> ProgressFn:
        place = group.index, position
        kept: dict[str, JsonData] = {}  # loss and psnr come every few steps; repeat them for the steps in between

        def report(done: int, total: int, **figures: JsonData) -> None:
            self.stop.check()
            phase = figures.pop("phase", "keyframe")
            kept.update(figures)
            with self._lock:
                self._clock.reached(place, kind, frames * done / total if total else 0.0)
                self._labels[place] = f"{words}: {phase}"
                fraction, label = self._clock.fraction, "; ".join(self._labels[key] for key in sorted(self._labels))
            self.reporter.progress(
                fraction, label, iteration=done, iterations=total, phase=phase, group=group.index, **where, **kept
            )

        return report

    def finished(self, group: Group, position: int, seconds: float) -> None:
        """Note that a frame, or with `WHOLE` all frames of the group jointly, are trained."""
        place = group.index, position
        kind: Kind = "joint" if position == WHOLE else kind_of(group, position)
        with self._lock:
            self._clock.finished(place, kind, seconds, len(group.frames) if position == WHOLE else 1)
            self._labels.pop(place, None)


class Previews:
    """Renders frames in training from the first held-out camera (or training camera), at most every `pause` seconds; 0:
    never. Thread-safe."""

    def __init__(
        self,
        reporter: StageReporter,
        footage: Footage,
        folder: Path,
        background: Sequence[float],
        device: str,
        pause: float,
    ) -> None:
        self._reporter, self._folder = reporter, folder
        self._camera = footage.rig[(*footage.held_out_cameras, *footage.train_cameras)[0]]
        self._background, self._device, self._pause = background, device, pause
        self._lock = threading.Lock()
        self._last = time.monotonic()

    def show(self, gaussians: Gaussians, group: Group, position: int, iteration: int | None = None) -> None:
        """Render a frame, unless a preview was rendered just before; `iteration`: None if it is finished."""
        with self._lock:
            if self._pause == 0 or time.monotonic() - self._last < self._pause:
                return
            self._last = time.monotonic()
        frame, name = group.frames[position], self._camera.name
        image = render(gaussians, self._camera, self._background, self._device, width=640)
        step = "" if iteration is None else f"_{iteration:06d}"
        path = self._folder / f"{group.first + position:06d}{step}.png"
        write_image(path, image)
        about = {"camera": name, "group": group.index, "frame": frame, "iteration": iteration}
        self._reporter.preview(path, f"frame {frame}, {name}", **about)
