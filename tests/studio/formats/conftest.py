"""Fixtures: random splats, and a small moving splat video."""

from collections.abc import Callable

import numpy as np
import pytest
import torch

from tests.support.splats import cloud
from tests.support.splats import noise as noise_of
from v3studio.studio.gaussians import Gaussians
from v3studio.studio.splat_video import SplatVideo

MakeVideo = Callable[..., SplatVideo]
MakeSplats = Callable[..., Gaussians]


def body(frame: int, count: int, degree: int, seed: int) -> Gaussians:
    """Splats of a body about 1 unit high that translates and rotates slightly in each frame."""
    noise = noise_of(seed)
    means = noise(count, 3) * torch.tensor([0.15, 0.15, 0.4])
    quats, log_scales, logits = noise(count, 4), noise(count, 3) * 0.4 - 3, noise(count) * 1.5 + 1
    sh = 0.4 * noise(count, (degree + 1) ** 2, 3)
    return Gaussians(
        means=means + 0.02 * frame * noise(count, 3).clamp(-1, 1),
        quats=quats + 0.03 * frame * noise(count, 4),
        log_scales=log_scales + 0.01 * frame,
        logit_opacities=logits,
        sh=sh,
    )


@pytest.fixture
def make_video() -> MakeVideo:
    """`make_video(lengths, splats, degree)`: groups of these lengths with different numbers of splats; 20 fps."""

    def make(lengths: tuple[int, ...] = (4, 3), splats: int = 150, degree: int = 0) -> SplatVideo:
        frames = [
            body(index, splats + 7 * group, degree, seed=group)
            for group, length in enumerate(lengths)
            for index in range(length)
        ]
        starts = np.cumsum([0, *lengths])[:-1]
        return SplatVideo(
            "test", 20.0, len(frames), tuple(int(start) for start in starts), frames.__getitem__,
            up=np.array([0.0, 0.0, 1.0]),
        )  # fmt: skip

    return make


@pytest.fixture
def make_splats() -> MakeSplats:
    return cloud
