"""The Triton kernels of the photometric loss against its definition. `test_interpreted.py` runs this file with
TRITON_INTERPRET=1.
"""

import pytest
import torch

from tests.studio.training.test_photometric import both, pair
from v3studio.studio.training.triton.loss import photometric_loss_triton


@pytest.mark.parametrize(("size", "weight"), [((1, 19), 0.2), ((14, 9), 0.0), ((17, 23), 0.2)])
def test_value_and_gradient(size: tuple[int, int], weight: float) -> None:
    image, target = pair(*size)
    with torch.no_grad():
        image[0, 0] = target[0, 0]  # no difference: the L1 term has no gradient there
    loss, gradient, true_loss, true_gradient = both(image, target, weight, photometric_loss_triton)
    torch.testing.assert_close(loss, true_loss, rtol=1e-5, atol=1e-6)
    assert (gradient - true_gradient).norm() <= 2e-5 * true_gradient.norm() + 1e-6
