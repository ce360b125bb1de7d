"""Fixtures: random splats."""

from collections.abc import Callable

import pytest
import torch

from studio.gaussians import Gaussians


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
