"""Fixtures: random splats, and a small moving splat video."""

from collections.abc import Callable

import numpy as np
import pytest
import torch

from studio.gaussians import Gaussians
from studio.splat_video import SplatVideo


def cloud(frame: int, splats: int, degree: int, seed: int) -> Gaussians:
    """Splats of a body about 1 unit high that translates and rotates slightly in each frame."""
    generator = torch.Generator().manual_seed(seed)

    def noise(*shape: int) -> torch.Tensor:
        return torch.randn(*shape, generator=generator)

    means = noise(splats, 3) * torch.tensor([0.15, 0.15, 0.4])
    quats, log_scales, logits = noise(splats, 4), noise(splats, 3) * 0.4 - 3, noise(splats) * 1.5 + 1
    sh = 0.4 * noise(splats, (degree + 1) ** 2, 3)
    return Gaussians(
        means=means + 0.02 * frame * noise(splats, 3).clamp(-1, 1),
        quats=quats + 0.03 * frame * noise(splats, 4),
        log_scales=log_scales + 0.01 * frame,
        logit_opacities=logits,
        sh=sh,
    )


@pytest.fixture
def make_video() -> Callable[..., SplatVideo]:
    """`make_video(lengths, splats, degree)`: groups of these lengths with different numbers of splats; 20 fps."""

    def make(lengths: tuple[int, ...] = (4, 3), splats: int = 150, degree: int = 0) -> SplatVideo:
        frames = [
            cloud(index, splats + 7 * group, degree, seed=group)
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
def make_splats() -> Callable[..., Gaussians]:
    """`make_splats(count, degree, seed)`: a cloud about 2 units across, SH from -1 to 1."""

    def make(count: int = 300, degree: int = 0, seed: int = 0) -> Gaussians:
        generator = torch.Generator().manual_seed(seed)

        def noise(*shape: int) -> torch.Tensor:
            return torch.randn(*shape, generator=generator)

        return Gaussians(
            means=noise(count, 3),
            quats=torch.nn.functional.normalize(noise(count, 4), dim=1),
            log_scales=noise(count, 3) * 0.7 - 4,
            logit_opacities=noise(count) * 1.5,
            sh=(0.3 * noise(count, (degree + 1) ** 2, 3)).clamp(-0.95, 0.95),
        )

    return make
