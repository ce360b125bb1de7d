"""The values that the profile `planes` codes, as the losses see them, against the baker's own arrays."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from tests.studio.rasterizer.conftest import make_splats
from v3studio.studio.gaussians import Gaussians
from v3studio.studio.stream.attributes import components
from v3studio.studio.stream.layout import component_frames
from v3studio.studio.stream.planes_coding import PlanesCoding
from v3studio.studio.stream.quantize import LEVELS_8, dequantize, quantize


def random_gaussians(count: int, seed: int = 0, dtype: torch.dtype = torch.float32) -> Gaussians:
    return make_splats(count, degree=1, seed=seed).to(dtype)


def test_columns_are_the_bakers_components() -> None:
    before, now = random_gaussians(20, seed=1), random_gaussians(20, seed=2)
    # the baker's sign of the first frame is w >= 0; ours follows the previous frame, so start from that sign
    signed = torch.where(before.quats[:, :1] < 0, -before.quats, before.quats)
    coding = PlanesCoding(replace(before, quats=signed))
    values = coding.coded_values(now).numpy().T
    baked = list(component_frames([before, now]))[1]
    names = [name for name, _ in components(1)]
    for attribute, prefix in (("rotation", "quat_"), ("scale", "log_scale_"), ("opacity", "opacity")):
        rows = [row for row, name in enumerate(names) if name.startswith(prefix)]
        assert np.allclose(values[coding.attributes[attribute]], baked[rows], atol=1e-6)
    sh = [row for row, name in enumerate(names) if name.startswith("sh_")]
    colors = np.concatenate([values[coding.attributes["color"]], values[coding.attributes["sh"]]])
    assert np.allclose(colors, baked[sh], atol=1e-6)
    assert sum(part.stop - part.start for part in coding.attributes.values()) == len(values) == 20


@pytest.mark.parametrize(("dtype", "error"), [(torch.float64, 1e-12), (torch.float32, 2e-6)])
@pytest.mark.parametrize("count", [1, 1029])
def test_the_kernel_equals_the_definition(count: int, dtype: torch.dtype, error: float) -> None:
    coding = PlanesCoding(random_gaussians(count, 1, dtype))
    results = []
    for function in (coding.coded_values, coding.coded_values_torch):
        leaves = random_gaussians(count, 0, dtype).map(lambda tensor: tensor.requires_grad_())
        values = function(leaves)
        upstream = torch.randn(values.shape, generator=torch.Generator().manual_seed(2), dtype=torch.float64).to(dtype)
        inputs = (leaves.quats, leaves.log_scales, leaves.logit_opacities, leaves.sh)
        results.append((values.detach(), *torch.autograd.grad(values, inputs, upstream)))
    for fused, expected in zip(*results, strict=True):
        assert float(((fused - expected).abs() / (1 + expected.abs())).max()) < 10 * error


def test_steps_are_the_bakers() -> None:
    splats = random_gaussians(500)
    coding = PlanesCoding(splats)
    values = coding.coded_values(splats)
    low, steps = values.amin(0), coding.steps(values)
    codes = torch.round((values - low) / steps)
    for column, plain in enumerate(values.numpy().T):
        lowest, highest = float(plain.min()), float(plain.max())
        baked = dequantize(quantize(plain, lowest, highest, LEVELS_8), lowest, highest, LEVELS_8)
        assert np.abs((codes * steps + low)[:, column].numpy() - baked).max() < 1e-5
