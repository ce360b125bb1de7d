"""The Triton kernels of the photometric loss against its definition. `test_interpreted.py` runs this file with
TRITON_INTERPRET=1.
"""

import pytest
import torch

from studio.training.photometric import photometric_loss_torch
from studio.training.triton.loss import photometric_loss_triton
from tests.studio.training.test_photometric import pair


@pytest.mark.parametrize(("size", "weight"), [((1, 19), 0.2), ((14, 9), 0.0), ((17, 23), 0.2)])
def test_value_and_gradient(size, weight) -> None:
    image, target = pair(*size)
    with torch.no_grad():
        image[0, 0] = target[0, 0]  # no difference: the L1 term has no gradient there
    loss = photometric_loss_triton(image, target, weight)
    (gradient,) = torch.autograd.grad(3 * loss, image)
    exact = image.detach().double().requires_grad_()
    true_loss = photometric_loss_torch(exact, target.double(), weight)
    (true_gradient,) = torch.autograd.grad(3 * true_loss, exact)
    assert loss.dtype == torch.float32
    torch.testing.assert_close(loss.detach().double(), true_loss.detach(), rtol=1e-5, atol=1e-6)
    assert (gradient - true_gradient).norm() <= 2e-5 * true_gradient.norm() + 1e-6
