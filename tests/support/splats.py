"""Splats of the files in tests/data/splats, checks of splats, and the file of a trained group."""

from collections.abc import Callable
from functools import partial

import numpy as np
import torch

from v3studio.pipelines.takes.files.json_files import write_model
from v3studio.pipelines.takes.results.stage_files import TrainedGroup
from v3studio.pipelines.takes.take import Take
from v3studio.studio.gaussians import Gaussians

COUNT = 260
"""More than a chunk of compressed PLY, and a row of SOG's palette have."""


def noise(seed: int) -> Callable[..., torch.Tensor]:
    """`torch.randn` of a generator of its own."""
    return partial(torch.randn, generator=torch.Generator().manual_seed(seed))


def cloud(count: int = 300, degree: int = 0, seed: int = 0) -> Gaussians:
    """A cloud about 2 units across, SH from -1 to 1."""
    random = noise(seed)
    return Gaussians(
        means=random(count, 3),
        quats=torch.nn.functional.normalize(random(count, 4), dim=1),
        log_scales=random(count, 3) * 0.7 - 4,
        logit_opacities=random(count) * 1.5,
        sh=(0.3 * random(count, (degree + 1) ** 2, 3)).clamp(-0.95, 0.95),
    )


def converted_splats(degree: int) -> Gaussians:
    """An uneven cloud about 2 units across, the same on every machine: NumPy never changes what RandomState returns."""
    random = np.random.RandomState(100 + degree)

    def noise(*shape: int) -> torch.Tensor:
        return torch.from_numpy(random.standard_normal(shape).astype(np.float32))

    return Gaussians(
        means=noise(COUNT, 3) * torch.tensor([0.5, 0.8, 0.3]) + torch.tensor([0.4, -0.2, 0.1]),
        quats=torch.nn.functional.normalize(noise(COUNT, 4), dim=1),
        log_scales=noise(COUNT, 3) * 0.5 - 2.5,
        logit_opacities=noise(COUNT) * 1.5 + 0.5,
        sh=(0.3 * noise(COUNT, (degree + 1) ** 2, 3)).clamp(-0.95, 0.95),
    )


def round_splats(means: torch.Tensor, log_scale: float = -3.0, opacity: float = 0.5) -> Gaussians:
    """Gray splats of the same size and opacity that are not rotated."""
    count = len(means)
    logits = torch.logit(torch.full((count,), opacity))
    quats = torch.tensor([1.0, 0, 0, 0]).repeat(count, 1)
    return Gaussians(means, quats, torch.full((count, 3), log_scale), logits, torch.zeros(count, 1, 3))


def same_splats(one: Gaussians, other: Gaussians) -> bool:
    """Whether all values have the same bits."""
    return all(torch.equal(value, getattr(other, name)) for name, value in one.items())


class Checkpoints(dict[int, dict[str, torch.Tensor]]):
    """Copies of the states that it is called with, by step."""

    def __call__(self, step: int, state: dict[str, torch.Tensor]) -> None:
        self[step] = {name: value.clone() for name, value in state.items()}


def assert_drawable(splats: Gaussians) -> None:
    """All that a renderer derives is finite: centers, axes of length 1, scales and their squares, opacities, colors."""
    for name, values in splats.items():
        assert torch.isfinite(values).all(), name
    assert torch.isfinite(splats.log_scales.exp().square()).all()
    assert torch.allclose(splats.unit_quats.norm(dim=-1), torch.ones(len(splats)), atol=1e-3)


def write_group(take: Take, group: int, frames: range) -> None:
    """Write a trained group's group.json, for frames that have the same numbers in the take and in the footage."""
    file = take.train_group(group) / "group.json"
    write_model(file, TrainedGroup(group=group, first=frames[0], frames=tuple(frames), splats=1, sh_degree=0))
