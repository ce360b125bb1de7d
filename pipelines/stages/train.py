"""Training: group after group, a keyframe and then frame after frame. A finished frame is never trained again."""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipelines.files import read_json, remove, write_json
from pipelines.frame_files import read_about, read_frame, read_tensors, write_frame, write_tensors
from pipelines.groups import Group
from pipelines.pictures import draw, write_picture
from pipelines.point_files import read_points
from pipelines.records import result_of
from pipelines.stages.arguments import NOT_TRAINING, train_settings
from pipelines.stages.base import (
    Context,
    Ingredients,
    StageReporter,
    derived_seed,
    key_of,
    leftover,
    settings_of,
    without,
)
from pipelines.stages.initialise import seen_by_training
from pipelines.stages.train_clock import TrainClock
from studio.errors import StudioError

if TYPE_CHECKING:
    from studio.gaussians import Gaussians
    from studio.training import TrainSettings, TrainView


class TrainStage:
    """See the module. A unit is a frame.

    Each frame's file carries the key of its recipe: the keyframe's is made of the settings that keyframes are trained
    by, seed, footage, cameras and initial points; each later frame's of the key before it, its frame number and the
    settings of motion and fine-tuning. So a longer take keeps the frames that it shares with the shorter one, another
    way of fine-tuning keeps the keyframes, and a resumed group continues exactly where it stopped.
    """

    name = "train"
    title = "Training"
    version = 2
    weight = 85.0
    needs: tuple[str, ...] = ("calibrate", "initialise")

    def ingredients(self, context: Context) -> Ingredients:
        """What training sees, how it trains, and which frames."""
        return {
            **self._recipe(context),
            **settings_of(context.config, "train.group_size"),
            "frames": list(context.raw_footage.frames),
        }

    def results(self, context: Context) -> list[Path]:
        """A file a frame."""
        return [context.take.trained_frame(group.index, index) for group in context.groups for index in group.indices]

    def units(self, context: Context) -> tuple[int, int, str] | None:
        """Frames that are trained by this recipe."""
        groups = context.groups
        done = sum(self._finished(context, group) for group in groups)
        return done, sum(len(group.frames) for group in groups), "frames"

    def run(self, context: Context, reporter: StageReporter) -> dict[str, Any]:
        """Train what is missing."""
        groups = context.groups
        footage = context.footage
        if not footage.train_cameras:
            raise StudioError("All cameras are held out, so there is none to train on; shorten capture.held_out.")
        finished = {group.index: self._finished(context, group) for group in groups}
        if context.config.train.check_footage:
            self._check_footage(context, reporter, groups, finished)
        reporter.start_clock()
        work = GroupWork(context, reporter, TrainClock(groups, finished, context.config.train))
        splats = []
        for group in groups:
            if finished[group.index] < len(group.frames):
                reporter.log(
                    f"group {group.index}: {finished[group.index]} of {len(group.frames)} frames are trained already"
                )
                work.train(group, finished[group.index], self._keys(context, group))
            self._drop_leftovers(context, group)
            splats.append(read_json(context.take.train_group(group.index) / "group.json")["splats"])
        for folder in leftover(
            context.take.root / "train", [context.take.train_group(group.index) for group in groups], "group_*"
        ):
            remove(folder)
        return {"groups": len(groups), "frames": len(footage.frames), "splats": splats}

    def _check_footage(
        self, context: Context, reporter: StageReporter, groups: tuple[Group, ...], finished: dict[int, int]
    ) -> None:
        """Raises StudioError if a frame that is still to be trained cannot be read or has no usable mask."""
        frames = tuple(frame for group in groups for frame in group.frames[finished[group.index] :])

        def tell(done: int, total: int, **figures: Any) -> None:
            reporter.progress(0.0, f"checking the footage, {done}/{total} images")

        problems = context.footage.check(tell, frames=frames)
        if problems:
            raise StudioError("\n".join(problems))

    def _recipe(self, context: Context) -> Ingredients:
        """Of all frames."""
        settings = without(settings_of(context.config, "train"), *(f"train.{name}" for name in NOT_TRAINING))
        return {**seen_by_training(context), **settings, **settings_of(context.config, "run.seed")}

    def _keys(self, context: Context, group: Group) -> list[str]:
        """Key of each frame of the group, in order."""
        from studio.training.settings import AFTER_KEYFRAME

        points = context.take.initialise_group(group.index) / "report.json"
        files = read_json(points).get("files") if points.is_file() else None
        recipe = self._recipe(context)
        later_names = [f"train.{name}" for name in AFTER_KEYFRAME]
        later = {name: recipe[name] for name in later_names}
        start = key_of(
            self.name,
            self.version,
            without(recipe, *later_names),
            result_of(context.take, "calibrate"),
            files,
            group.index,
        )
        keys = [key_of(self.name, self.version, start, group.keyframe)]
        for frame in group.frames[1:]:
            keys.append(key_of(self.name, self.version, keys[-1], later, frame))
        return keys

    def _finished(self, context: Context, group: Group) -> int:
        """How many frames of the group, from its first on without a gap, are trained by this recipe."""
        take, keys = context.take, self._keys(context, group)
        count = 0
        for index, key in zip(group.indices, keys, strict=True):
            about = read_about(take.trained_frame(group.index, index))
            if about is None or about.get("key") != key:
                break
            count += 1
        if context.config.train.motion_warm_start:
            # the frame after needs this one's network
            while 1 < count < len(keys):
                about = read_about(take.motion_network(group.index, group.first + count - 1))
                if about is not None and about.get("key") == keys[count - 1]:
                    break
                count -= 1
        return count

    def _drop_leftovers(self, context: Context, group: Group) -> None:
        wanted = [context.take.trained_frame(group.index, index) for index in group.indices]
        for path in leftover(context.take.train_group(group.index), wanted, "frame_*.safetensors"):
            remove(path)
        for path in context.take.train_group(group.index).glob("motion_*.safetensors"):
            remove(path)


class GroupWork:
    """Trains groups: holds what all frames share."""

    def __init__(self, context: Context, reporter: StageReporter, clock: TrainClock) -> None:
        self.context, self.reporter, self.clock = context, reporter, clock
        self.settings: TrainSettings = train_settings(context.config.train)
        self._last_preview = time.monotonic()

    def train(self, group: Group, finished: int, keys: list[str]) -> None:
        """Train the group's frames from the `finished`-th on, each written when it is done.

        Raises:
            StudioError: unusable footage, or training diverged.
            Cancelled: the run was asked to stop.
        """
        take = self.context.take
        timings = self._timings(group, finished)
        previous = read_frame(take.trained_frame(group.index, group.first + finished - 1)) if finished else None
        before = read_frame(take.trained_frame(group.index, group.first + finished - 2)) if finished > 1 else None
        # one frame ahead: the next frame's images are decoded while this one trains
        with ThreadPoolExecutor(1, thread_name_prefix="footage") as ahead:
            views: Future[list[TrainView]] = ahead.submit(self._views, group.frames[finished])
            for position in range(finished, len(group.frames)):
                current = views.result()
                if position + 1 < len(group.frames):
                    views = ahead.submit(self._views, group.frames[position + 1])
                started = time.monotonic()
                self.clock.start(group, position)
                self.reporter.forget_figures()
                gaussians = self._frame(group, position, previous, before, current, keys)
                seconds = time.monotonic() - started
                self.clock.finished(group, position, seconds)
                timings.append(round(seconds, 3))
                self._write(group, position, gaussians, keys[position], timings)
                self._tell(group, position, gaussians, seconds)
                previous, before = gaussians, previous

    def _frame(
        self,
        group: Group,
        position: int,
        previous: Gaussians | None,
        before: Gaussians | None,
        views: list[TrainView],
        keys: list[str],
    ) -> Gaussians:
        from studio.training import train_interframe

        take, index = self.context.take, group.first + position
        device = self.context.device
        seed = derived_seed(self.context.config.run.seed, "train", group.index, position)

        def snapshot(iteration: int, gaussians: Gaussians) -> None:
            self._preview(group, position, gaussians, iteration)

        if previous is None:
            return self._keyframe(group, views, keys[0], seed, snapshot)
        warm_start = None
        if self.settings.motion_warm_start and position > 1:
            warm_start = read_tensors(take.motion_network(group.index, index - 1), keys[position - 1])
            warm_start = warm_start and {name: value.to(device) for name, value in warm_start.items()}
        found = train_interframe(
            previous.to(device),
            views,
            self.settings,
            before_previous=None if before is None else before.to(device),
            warm_start=warm_start,
            seed=seed,
            progress=self._progress(group, position),
            snapshot=snapshot,
        )
        if self.settings.motion_warm_start:
            write_tensors(take.motion_network(group.index, index), found.motion, {"key": keys[position]})
            remove(take.motion_network(group.index, index - 2))
        return found.gaussians.detach().to("cpu")

    def _keyframe(
        self, group: Group, views: list[TrainView], key: str, seed: int, snapshot: Callable[[int, Gaussians], None]
    ) -> Gaussians:
        """From its checkpoint, where a run of the same recipe left one."""
        import torch

        from studio.training import train_keyframe

        take, device = self.context.take, self.context.device
        path = take.keyframe_checkpoint(group.index)

        def keep(step: int, state: dict[str, torch.Tensor]) -> None:
            path.parent.mkdir(parents=True, exist_ok=True)
            write_tensors(path, state, {"key": key, "step": step, "frame": group.keyframe})

        resume = read_tensors(path, key)
        if resume is not None:
            self.reporter.log(f"group {group.index}: the keyframe goes on from step {int(resume['done'])}")
        points, colors = read_points(take.initialise_group(group.index) / "points.ply")
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

    def _progress(self, group: Group, position: int) -> Any:
        frame = group.frames[position]
        total_groups = len(self.context.groups)
        label = f"group {group.index + 1}/{total_groups}, frame {position + 1}/{len(group.frames)}"

        def tell(done: int, total: int, **figures: Any) -> None:
            phase = figures.pop("phase", "keyframe")
            share = done / total if total else 0.0
            fraction = self.clock.fraction(share)
            # loss and psnr come every few steps; StageReporter remembers them in between
            self.reporter.progress(
                fraction,
                f"{label}: {phase}",
                iteration=done,
                iterations=total,
                phase=phase,
                group=group.index,
                frame=frame,
                index=group.first + position,
                **figures,
            )

        return tell

    def _views(self, frame: int) -> list[TrainView]:
        from studio.training import TrainView

        footage, device = self.context.footage, self.context.device
        views = []
        for camera in footage.train_cameras:
            self.context.cancellation.check()
            view = footage.view(camera, frame)
            if (view.matte > 127).any():
                views.append(TrainView.from_view(view, device, self.settings.crop_margin))
            else:
                self.reporter.warn(f"{camera} does not see the performer in frame {frame}; left out there.")
        if not views:
            raise StudioError(f"No training camera sees the performer in frame {frame}; check the masks.")
        return views

    def _timings(self, group: Group, finished: int) -> list[float]:
        """Seconds that the finished frames took, as far as they are known."""
        path = self.context.take.train_group(group.index) / "group.json"
        known = read_json(path).get("seconds", []) if path.is_file() else []
        return [*known[:finished], *[0.0] * (finished - len(known))]

    def _write(self, group: Group, position: int, gaussians: Gaussians, key: str, timings: list[float]) -> None:
        take = self.context.take
        about = {"key": key, "group": group.index, "index": group.first + position, "frame": group.frames[position]}
        folder = take.train_group(group.index)
        folder.mkdir(parents=True, exist_ok=True)
        # group.json first: it is there, if perhaps a line ahead, whenever the frame is
        write_json(
            folder / "group.json",
            {
                "group": group.index,
                "first": group.first,
                "frames": list(group.frames),
                "splats": len(gaussians),
                "sh_degree": gaussians.sh_degree,
                "seconds": timings,
            },
        )
        write_frame(take.trained_frame(group.index, group.first + position), gaussians, about)
        remove(take.keyframe_checkpoint(group.index))

    def _tell(self, group: Group, position: int, gaussians: Gaussians, seconds: float) -> None:
        frame = group.frames[position]
        values = {"index": group.first + position, "splats": len(gaussians), "seconds": round(seconds, 2)}
        self.reporter.metrics(values, group=group.index, frame=frame)
        self._preview(group, position, gaussians, None)

    def _preview(self, group: Group, position: int, gaussians: Gaussians, iteration: int | None) -> None:
        """A picture from a held-out camera (else the first training camera), not more often than asked for."""
        pause = self.context.config.run.preview_seconds
        if pause == 0 or time.monotonic() - self._last_preview < pause:
            return
        self._last_preview = time.monotonic()
        footage = self.context.footage
        camera = (*footage.held_out_cameras, *footage.train_cameras)[0]
        frame = group.frames[position]
        picture = draw(
            gaussians, footage.rig[camera], self.context.config.capture.background, self.context.device, width=640
        )
        name = f"{group.first + position:06d}{'' if iteration is None else f'_{iteration:06d}'}.png"
        path = self.context.take.previews / name
        write_picture(path, picture)
        self.reporter.preview(
            path,
            f"frame {frame}, {camera}",
            camera=camera,
            group=group.index,
            frame=frame,
            iteration=iteration,
        )
