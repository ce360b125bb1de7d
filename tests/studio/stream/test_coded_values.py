"""The values that the paper codes, as the losses see them, against the arrays that are baked."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from tests.studio.rasterizer.conftest import make_splats
from v3studio.studio.gaussians import Gaussians
from v3studio.studio.stream.attributes import component_rows
from v3studio.studio.stream.coded_values import CodedValues
from v3studio.studio.stream.layout import component_frames


def random_gaussians(count: int, seed: int = 0, dtype: torch.dtype = torch.float32) -> Gaussians:
    return make_splats(count, degree=1, seed=seed).to(dtype)


def test_columns_are_the_bakers_components() -> None:
    before, now = random_gaussians(20, seed=1), random_gaussians(20, seed=2)
    # the baker's sign of the first frame is w >= 0; ours follows the previous frame, so start from that sign
    signed = torch.where(before.quats[:, :1] < 0, -before.quats, before.quats)
    coding = CodedValues(replace(before, quats=signed))
    values = coding.coded_values(now).numpy().T
    baked = list(component_frames([before, now]))[1]
    rows = component_rows(1)
    for attribute, name in (("rotation", "quats"), ("scale", "scales"), ("opacity", "opacities")):
        assert np.allclose(values[coding.attributes[attribute]], baked[rows[name]], atol=1e-6)
    colors = np.concatenate([values[coding.attributes["color"]], values[coding.attributes["sh"]]])
    assert np.allclose(colors, baked[rows["sh"]], atol=1e-6)
    assert sum(part.stop - part.start for part in coding.attributes.values()) == len(values) == 20


@pytest.mark.parametrize(("dtype", "error"), [(torch.float64, 1e-12), (torch.float32, 2e-6)])
@pytest.mark.parametrize("count", [1, 1029])
def test_the_kernel_equals_the_definition(count: int, dtype: torch.dtype, error: float) -> None:
    coding = CodedValues(random_gaussians(count, 1, dtype))
    results = []
    for function in (coding.coded_values, coding.coded_values_torch):
        leaves = random_gaussians(count, 0, dtype).map(lambda tensor: tensor.requires_grad_())
        values = function(leaves)
        upstream = torch.randn(values.shape, generator=torch.Generator().manual_seed(2), dtype=torch.float64).to(dtype)
        inputs = (leaves.quats, leaves.log_scales, leaves.logit_opacities, leaves.sh)
        results.append((values.detach(), *torch.autograd.grad(values, inputs, upstream)))
    for fused, expected in zip(*results, strict=True):
        assert float(((fused - expected).abs() / (1 + expected.abs())).max()) < 10 * error


def test_steps_divide_the_range_into_256_levels() -> None:
    splats = random_gaussians(500)
    coding = CodedValues(splats)
    values = coding.coded_values(splats)
    assert torch.allclose(255 * coding.steps(values), values.amax(0) - values.amin(0))
