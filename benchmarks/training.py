"""Speed of training on the CPU: each fused part against its PyTorch definition, and whole steps.

    python benchmarks/training.py TAKE [--rounds 25]    # a trained take, such as demo-take; about two minutes

The first two frames of the take are used: their splats, their views and the take's settings. The two sides of each
comparison alternate in one process. Times are CPU times of one thread, in milliseconds: median and minimum, so that
other load on the machine matters little. The share of a part is its median time, times its calls in a step, over that
of the whole step.
"""

import argparse
import os
import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

os.environ.setdefault("OMP_WAIT_POLICY", "passive")

import torch
from rich.console import Console

from v3studio.pipelines.config import load_config
from v3studio.pipelines.reports.terminal import table_of
from v3studio.pipelines.stages.inputs import Inputs
from v3studio.pipelines.takes.frames.frame_files import read_frame
from v3studio.pipelines.takes.take import Take
from v3studio.studio.gaussians import Gaussians
from v3studio.studio.rasterizer import rasterize, set_kernel_threads
from v3studio.studio.rasterizer.cpu import load_kernels
from v3studio.studio.rasterizer.kernels import definitions_only
from v3studio.studio.stream.coded_values import CodedValues
from v3studio.studio.training import TrainingView, TrainSettings
from v3studio.studio.training.adam import Adam, ParameterGroup
from v3studio.studio.training.coded_loss import CodedLoss
from v3studio.studio.training.dropout import drop_splats
from v3studio.studio.training.hashgrid import Corners, HashGrid
from v3studio.studio.training.interframe import performer_box
from v3studio.studio.training.keyframe import scene_extent
from v3studio.studio.training.motion import MotionField
from v3studio.studio.training.photometric import photometric_loss, photometric_loss_torch
from v3studio.studio.training.splat_optimizer import SplatOptimizer
from v3studio.studio.training.step import Stepper, regularized

console = Console(width=112)


@dataclass
class Pair:
    """Times of one computation in milliseconds, fused and by its definition."""

    name: str  # what is computed, forward and backward
    fused: tuple[float, float]  # fused, plain: (median, minimum)
    plain: tuple[float, float]
    calls: dict[str, int]  # by the step that it is part of


def timed(function: Callable[[], object]) -> float:
    """CPU time of one call in milliseconds, of this thread."""
    started = time.thread_time()
    function()
    return 1e3 * (time.thread_time() - started)


def alternate(fused: Callable[[], object], plain: Callable[[], object], rounds: int) -> tuple[list[float], list[float]]:
    """Times of both, one call after the other; `plain` runs with `definitions_only`."""
    times: tuple[list[float], list[float]] = ([], [])
    for _ in range(rounds + 2):
        times[0].append(timed(fused))
        with definitions_only():
            times[1].append(timed(plain))
    return times[0][2:], times[1][2:]  # the first calls allocate memory


class Scene:
    """Two frames of a take, ready for the steps of training."""

    def __init__(self, folder: Path, rounds: int) -> None:
        take, config = Take.open(folder), load_config(folder / "config.yaml")
        inputs = Inputs(take, config)
        self.settings: TrainSettings = config.train
        group = inputs.groups[0]
        footage = inputs.trained_footage
        self.previous, self.now = (read_frame(take.trained_frame(0, group.first + i)) for i in (0, 1))
        self.views = [
            TrainingView.from_view(
                footage.view(camera, group.frames[1]), "cpu", self.settings.crop_margin, self.settings.use_plates
            )
            for camera in footage.train_cameras
        ]
        self.rounds = rounds
        self.pairs: list[Pair] = []

    def pair(
        self, name: str, fused: Callable[[], object], plain: Callable[[], object] | None = None, /, **calls: int
    ) -> None:
        """Measure a function against another one; None: it chooses the kernel by itself."""
        times = alternate(fused, plain or fused, self.rounds)
        first, second = ((statistics.median(side), min(side)) for side in times)
        self.pairs.append(Pair(name, first, second, calls))

    def leaves(self) -> Gaussians:
        """Splats of the second frame that require gradients."""
        return self.now.map(lambda tensor: tensor.clone().requires_grad_())

    def parts(self) -> None:
        settings, splats = self.settings, self.leaves()
        every = {"keyframe": 1, "motion": settings.motion_views, "finetune": 1}
        field, corners = self.field()
        upstream = torch.randn(len(splats), 3)
        parameters = list(field.parameters())
        self.pair("motion field", lambda: torch.autograd.grad(field(corners), parameters, upstream), motion=1)
        view, black = self.views[0], torch.zeros(3)
        leaves = [tensor for _, tensor in splats.items()]

        def render() -> object:
            rendered = rasterize(splats, view.camera, black)
            return torch.autograd.grad([rendered.image, rendered.alpha], leaves, [view.image, view.mask])

        self.pair("rendering", render, **every)
        image = view.over(black)[0].clone().requires_grad_()
        target = view.over(torch.ones(3))[0]
        self.pair(
            "image loss",
            lambda: torch.autograd.grad(photometric_loss(image, target, settings.dssim_weight), image),
            lambda: torch.autograd.grad(photometric_loss_torch(image, target, settings.dssim_weight), image),
            **every,
        )
        self.pair("image over a color", lambda: view.over(black)[0], **every)
        logits = splats.logit_opacities
        dropout = lambda: torch.autograd.grad(drop_splats(logits, settings.dropout, 1).sum(), logits)  # noqa: E731
        self.pair("dropout", dropout, keyframe=1, finetune=1)
        coding = CodedValues(self.previous)
        inputs = [splats.quats, splats.log_scales, splats.logit_opacities, splats.sh]
        values = coding.coded_values(splats).detach().requires_grad_()
        ones = torch.ones_like(values)
        self.pair("coded values", lambda: torch.autograd.grad(coding.coded_values(splats), inputs, ones), finetune=1)
        coded = self.coded()
        learned = [values, *coded.parameters()]
        self.pair("entropy and temporal loss", lambda: torch.autograd.grad(coded(values, 5)[0], learned), finetune=1)

    def field(self) -> tuple[MotionField, Corners]:
        """A motion field after a few updates, and its corners."""
        generator = torch.Generator().manual_seed(0)
        grid = HashGrid(self.settings.hash_levels, generator=generator)
        low, high = performer_box(self.previous.means)
        field = MotionField(low, high, grid, self.settings.mlp_width, self.settings.mlp_layers, generator)
        with torch.no_grad():  # the last layer starts at zero
            for parameter in field.mlp[-1].parameters():
                parameter.normal_(0, 0.01, generator=generator)
        return field, field.corners(self.previous.means)

    def coded(self) -> CodedLoss:
        settings, coding = self.settings, CodedValues(self.previous)
        before = coding.coded_values(self.previous).detach()
        weights = (settings.entropy_weight, settings.temporal_weight)
        return CodedLoss(before, coding.steps(before), coding.attributes, coding.pixels, *weights)

    def steps(self) -> None:
        """Measure whole steps, as `keyframe.py` and `interframe.py` run them."""
        settings = self.settings
        extent = scene_extent(self.now.means)
        stepper = Stepper(self.views[:1], settings, torch.Generator().manual_seed(0))
        optimizer = SplatOptimizer(self.now, settings.rates, extent)

        def keyframe() -> None:
            splats = optimizer.gaussians
            loss = regularized(stepper(splats, dropout=True).loss, splats, settings, extent)
            loss.backward()  # type: ignore[no-untyped-call]
            optimizer.step()

        self.pair("whole step", keyframe, keyframe=1)
        field, corners = self.field()
        adam = field.optimizer(1e-9)  # the scene stays as it is

        def motion() -> None:
            moved = replace(self.previous, means=self.previous.means + field(corners))
            losses = [stepper(moved).loss for _ in range(settings.motion_views)]
            torch.stack(losses).mean().backward()  # type: ignore[no-untyped-call]
            adam.step()
            adam.zero_grad()

        self.pair("whole step", motion, motion=1)
        coding, coded = CodedValues(self.previous), self.coded()
        entropy_adam = Adam([ParameterGroup(list(coded.parameters()), 1e-9)])
        tuned = SplatOptimizer(self.now, settings.rates, extent, train_means=settings.finetune_means)

        def tune() -> None:
            splats = tuned.gaussians
            now = coding.coded_values(splats)
            loss = stepper(splats, dropout=True).loss + coded(now, 5)[0]
            loss.backward()  # type: ignore[no-untyped-call]
            tuned.step()
            entropy_adam.step()
            entropy_adam.zero_grad()

        self.pair("whole step", tune, finetune=1)


def show(pairs: list[Pair]) -> None:
    """Print one row per part, and whole steps."""
    table = table_of("step", "part", "calls", "fused", "definition", "ratio", "share of the step", left=(0, 1))
    table.title = "CPU time of one thread in ms, median / minimum"
    whole = {step: pair.fused[0] for pair in pairs if pair.name == "whole step" for step in pair.calls}
    for step in whole:
        for pair in (pair for pair in pairs if step in pair.calls):
            fused, plain = (f"{median:.2f} / {least:.2f}" for median, least in (pair.fused, pair.plain))
            versus = ("", "") if pair.name == "rendering" else (plain, f"{pair.plain[0] / pair.fused[0]:.2f}")
            share = f"{pair.calls[step] * pair.fused[0] / whole[step]:.0%}"
            table.add_row(step, pair.name, str(pair.calls[step]), fused, *versus, share)
        table.add_section()
    console.print(table)


def main(words: Sequence[str] | None = None) -> list[Pair]:
    """Measure, print, and return the results."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("take", type=Path, help="a trained take")
    parser.add_argument("--rounds", type=int, default=25, help="calls of each side")
    options = parser.parse_args(words)
    torch.set_num_threads(1)
    set_kernel_threads(1)
    scene = Scene(options.take, options.rounds)
    scene.parts()
    scene.steps()
    kernels = load_kernels().instruction_set()
    console.print(f"{len(scene.now)} splats, {len(scene.views)} views, {kernels}, load {os.getloadavg()[0]:.1f}")
    show(scene.pairs)
    return scene.pairs


if __name__ == "__main__":
    main()
