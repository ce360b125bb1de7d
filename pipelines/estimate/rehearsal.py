"""Measures this machine with the footage itself: some images, a coarse hull, and some steps of each kind of training.

All groups that would be trained in parallel are rehearsed in parallel, so that what they share (memory bandwidth,
caches) slows the rehearsal as it will slow the run.
"""

import tempfile
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from statistics import fmean
from typing import Any

import psutil
import torch

from v3studio.pipelines.estimate.work import Work
from v3studio.pipelines.events.cancellation import Cancellation
from v3studio.pipelines.stages.evaluate import lpips_of
from v3studio.pipelines.stages.inputs import Inputs
from v3studio.pipelines.stages.training.group_scheduler import run_groups, threads_by_group
from v3studio.studio.comparison import ViewPair, measure, padded_box
from v3studio.studio.footage import FootageView
from v3studio.studio.gaussians import Gaussians
from v3studio.studio.meshing import InitResult, initialize_points
from v3studio.studio.meshing.settings import InitializeSettings
from v3studio.studio.progress import ProgressFn, no_progress
from v3studio.studio.stream import BakeSettings, bake_group
from v3studio.studio.training import TrainingView, train_interframe, train_keyframe

SECONDS = 12.0  # of training in the rehearsal: half for the keyframe, a quarter each for motion and fine-tuning
_CAMERAS = 12  # most cameras that are read; more would take minutes for large rigs
RESOLUTIONS = (32, 96, 144)
"""Resolutions of the hulls that are made; the first only loads the libraries. A hull's time is a constant plus one that
grows with the square of its resolution, as the number of its triangles does."""
_UNSTEADY = 0.25  # the first part of the steps of each kind, which is not measured


class _Enough(Exception):
    """Ends training in a rehearsal."""


@dataclass
class Measured:
    """Seconds per unit of work, on this machine at its present load."""

    camera: float = 0.0  # extra time of a camera's first image (opening the file, estimating its background)
    view: float = 0.0  # decoding, masking and cropping one image
    hull_fixed: float = 0.0  # hull_fixed, hull_square: a hull of resolution r takes hull_fixed + hull_square r^2
    hull_square: float = 0.0
    keyframe_step: float = 0.0  # one step per splat of the keyframe before pruning
    motion_step: float = 0.0  # motion_step, finetune_step: one step of a later frame, with its final number of splats
    finetune_step: float = 0.0
    frame: float = 0.0  # a later frame, apart from its steps
    evaluated_view: float = 0.0  # rendering and comparing one view of the evaluation
    baked_frame: float = 0.0
    memory: int = 0  # bytes of the process after the rehearsal
    # share of the processor that the rehearsal got, 0 to 1; the rest went to other programs or was idle
    processor: float = 1.0


@dataclass
class _Steps:
    """A progress callback that notes when each step ended and ends training after `limit` seconds."""

    limit: float
    check: Callable[[], None]
    ends: list[float] = field(default_factory=list)

    def __call__(self, done: int, total: int, **figures: Any) -> None:
        self.check()
        now = time.perf_counter()
        self.ends.append(now)
        if now - self.ends[0] > self.limit:
            raise _Enough

    @property
    def seconds(self) -> float:
        """Mean of the steady steps; 0 if there were none."""
        first = min(int(len(self.ends) * _UNSTEADY), len(self.ends) - 2)
        return (self.ends[-1] - self.ends[first]) / (len(self.ends) - 1 - first) if self.ends else 0.0


def rehearse(inputs: Inputs, work: Work, progress: ProgressFn = no_progress) -> Measured:
    """Measure the work of a take whose cameras are known; about 20 s on an idle machine."""
    parts = 4 + work.at_once
    progress(0, parts)
    views, training, reading = _read(inputs)
    progress(1, parts)
    points, hulls = _hulls(inputs.config.initialize, work, views)
    progress(2, parts)
    results: list[tuple[dict[str, float], Gaussians]] = []
    started, processor = time.perf_counter(), time.process_time()
    lock, stop = threading.Lock(), Cancellation()

    def train() -> None:
        one = _train(inputs, work, points, training, stop.check)
        with lock:
            results.append(one)
            progress(2 + len(results), parts)

    threads = threads_by_group(len(work.groups), work.at_once, work.threads)[:1] * work.at_once
    run_groups(dict.fromkeys(range(work.at_once), train), work.at_once, threads, stop)
    steps = {name: fmean(seconds[name] for seconds, _ in results) for name in results[0][0]}
    spent = time.process_time() - processor
    share = min(1.0, spent / ((time.perf_counter() - started) * sum(threads)))
    splats = results[0][1]
    progress(2 + work.at_once, parts)
    evaluated = _evaluate(inputs, views[0], splats)
    progress(3 + work.at_once, parts)
    baked = _bake(inputs.config.bake, splats, inputs.threads)
    memory = psutil.Process().memory_info().rss
    progress(parts, parts)
    return Measured(
        **reading, **hulls, **steps, evaluated_view=evaluated, baked_frame=baked, memory=memory, processor=share
    )


def _read(inputs: Inputs) -> tuple[list[FootageView], list[TrainingView], dict[str, float]]:
    """Views of the first keyframe; those that show the performer as training views; and seconds, as in `Measured`."""
    footage, settings = inputs.calibrated_footage, inputs.config.train
    every = max(1, len(footage.train_cameras) // _CAMERAS)
    names = footage.train_cameras[::every][:_CAMERAS]
    frames = inputs.groups[0].frames[:2]
    seconds: list[float] = []
    views: list[FootageView] = []
    training: list[TrainingView] = []
    for position, frame in enumerate(frames):
        begun = time.perf_counter()
        for name in names:
            view = footage.view(name, frame)
            if not (view.mask > 127).any():
                continue
            seen = TrainingView.from_view(view, inputs.device, settings.crop_margin, settings.use_plates)
            if position == 0:
                views.append(view)
                training.append(seen)
        seconds.append((time.perf_counter() - begun) / len(names))
    return views, training, {"view": seconds[-1], "camera": max(0.0, seconds[0] - seconds[-1])}


def _hulls(settings: InitializeSettings, work: Work, views: list[FootageView]) -> tuple[InitResult, dict[str, float]]:
    """Initial points on a coarse hull, as many as there are splats after densification; and seconds of hulls."""
    seconds = []
    for resolution in RESOLUTIONS:
        faces = max(100, round(settings.max_faces * (resolution / settings.resolution) ** 2))
        coarse = settings.replace(resolution=resolution, max_faces=faces, points=work.splats_before_pruning)
        begun = time.perf_counter()
        made = initialize_points(views, coarse)
        seconds.append(time.perf_counter() - begun)
    _, low, high = RESOLUTIONS
    square = max(0.0, seconds[2] - seconds[1]) / (high**2 - low**2)
    return made, {"hull_square": square, "hull_fixed": max(0.0, seconds[1] - square * low**2)}


def _train(
    inputs: Inputs, work: Work, hull: InitResult, views: list[TrainingView], check: Callable[[], None]
) -> tuple[dict[str, float], Gaussians]:
    """Rehearse one group: seconds of each kind of step, and a frame's splats."""
    points, colors = (torch.from_numpy(array).to(inputs.device) for array in (hull.points, hull.colors))
    settings = inputs.config.train
    settings = settings.replace(densify_from=settings.keyframe_iterations, motion_first_iterations=None)
    latest: deque[Gaussians] = deque(maxlen=1)
    steps = _Steps(SECONDS / 2, check)

    def keep(step: int, gaussians: Gaussians) -> None:
        latest.append(gaussians)

    with suppress(_Enough):
        keep(0, train_keyframe(views, points, colors, settings, progress=steps, snapshot=keep, snapshot_every=1))
    found = {"keyframe_step": steps.seconds / len(points), "frame": 0.0}
    splats = latest[0].detach()
    order = splats.logit_opacities.argsort(descending=True)[: work.splats]
    splats = splats.map(lambda tensor: tensor[order].clone())
    for name, other in (("motion_step", "finetune_iterations"), ("finetune_step", "motion_iterations")):
        steps, one_kind = _Steps(SECONDS / 4, check), settings.replace(**{other: 0})
        begun = time.perf_counter()
        with suppress(_Enough):
            train_interframe(splats, views, one_kind, before_previous=splats.clone(), progress=steps)
        found[name] = steps.seconds
        if steps.ends:  # the time until the first step is that of the frame
            found["frame"] += steps.ends[0] - begun
    return found, splats


def _evaluate(inputs: Inputs, view: FootageView, splats: Gaussians) -> float:
    """Seconds to render and compare one view of the evaluation, apart from reading its image."""
    background, lpips = inputs.config.evaluate.background, lpips_of(inputs.config, inputs.device)
    box = padded_box(view.mask, inputs.config.evaluate.crop_padding)
    begun = time.perf_counter()
    for _ in ("trained", "decoded"):
        pair = ViewPair.of(splats, view.camera, view.image, view.mask, background, box, inputs.device)
        measure(pair, lpips)
    return time.perf_counter() - begun


def _bake(bake: BakeSettings, splats: Gaussians, threads: int) -> float:
    """Seconds per frame to encode and decode; with a ladder, of all renditions that need no training."""
    frames = 4
    settings = type(bake)(quality=bake.qp, preset=bake.preset)
    still = splats.detach().to("cpu")
    with tempfile.TemporaryDirectory() as folder:
        begun = time.perf_counter()
        bake_group([still] * frames, Path(folder), 0, 0, settings, threads=threads)
        seconds = time.perf_counter() - begun
    return max(1, len(bake.ladder)) * seconds / frames
