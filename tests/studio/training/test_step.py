"""The cost of opacities and scales, in NumPy."""

import numpy as np
import pytest
import torch

from tests.support.splats import cloud
from v3studio.studio.training import TrainSettings
from v3studio.studio.training.step import regularized


@pytest.mark.parametrize("weights", [(0.01, 0.2), (0.3, 0.0), (0.0, 0.7), (0.0, 0.0)])
def test_opacities_and_scales_are_regularized(weights: tuple[float, float]) -> None:
    splats = cloud(50)
    logits, scales = (tensor.double().numpy() for tensor in (splats.logit_opacities, splats.log_scales))
    settings = TrainSettings(opacity_reg=weights[0], scale_reg=weights[1])
    expected = 0.5 + weights[0] * (1 / (1 + np.exp(-logits))).mean() + weights[1] * np.exp(scales).mean() / 3
    assert float(regularized(torch.tensor(0.5), splats, settings, extent=3.0)) == pytest.approx(expected, rel=1e-6)
