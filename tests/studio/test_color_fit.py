"""The color fit against NumPy's least squares and the closed form of ridge regression."""

import numpy as np
import torch

from v3studio.studio.color_fit import correct_color, fit_color, neutral


def drawn() -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    generator = torch.Generator().manual_seed(0)
    alpha = torch.rand(400, generator=generator, dtype=torch.float64)
    premultiplied = torch.rand(400, 3, generator=generator, dtype=torch.float64) * alpha[:, None]
    target = torch.rand(400, 3, generator=generator, dtype=torch.float64)
    return premultiplied, alpha, target


def test_without_ridge_it_is_least_squares() -> None:
    premultiplied, alpha, target = drawn()
    weights = torch.arange(400) % 3 > 0
    fit = fit_color(premultiplied, alpha, target, weights)
    base = np.concatenate([premultiplied, alpha[:, None]], 1)[weights.numpy()]
    assert np.allclose(fit.T, np.linalg.lstsq(base, target[weights].numpy(), rcond=None)[0], atol=1e-9)


def test_what_the_colors_do_not_determine_stays_neutral() -> None:
    gray = torch.full((50, 3), 0.5)
    fit = fit_color(gray, torch.ones(50), gray)
    assert torch.allclose(fit, neutral(), atol=1e-9)
    assert torch.allclose(fit_color(gray[:0], torch.ones(0), gray[:0]), neutral())


def test_the_fitted_matrix_brings_the_drawing_to_the_target() -> None:
    premultiplied, alpha, _ = drawn()
    matrix = torch.tensor([[0.9, 0.1, 0, 0.02], [0, 1.2, -0.1, 0], [0.05, 0, 0.8, -0.03]], dtype=torch.float64)
    image = premultiplied.view(20, 20, 3)
    target = correct_color(image, alpha.view(20, 20), matrix)
    # applied to the color itself, before it is multiplied with alpha
    color = premultiplied / alpha[:, None]
    assert torch.allclose(target.view(-1, 3), (color @ matrix[:, :3].T + matrix[:, 3]) * alpha[:, None])
    assert torch.allclose(fit_color(image, alpha.view(20, 20), target), matrix, atol=1e-9)
