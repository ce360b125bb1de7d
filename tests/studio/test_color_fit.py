"""The color fit against NumPy's least squares and the closed form of ridge regression."""

import numpy as np
import torch

from studio.color_fit import correct_color, fit_color, neutral, uncorrected


def drawn() -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    generator = torch.Generator().manual_seed(0)
    alpha = torch.rand(400, generator=generator, dtype=torch.float64)
    premultiplied = torch.rand(400, 3, generator=generator, dtype=torch.float64) * alpha[:, None]
    target = torch.rand(400, 3, generator=generator, dtype=torch.float64)
    return premultiplied, alpha, target


def test_without_ridge_it_is_least_squares():
    premultiplied, alpha, target = drawn()
    weights = torch.arange(400) % 3 > 0
    found = fit_color(premultiplied, alpha, target, weights)
    base = np.concatenate([premultiplied, alpha[:, None]], 1)[weights.numpy()]
    assert np.allclose(found.T, np.linalg.lstsq(base, target[weights].numpy(), rcond=None)[0], atol=1e-9)


def test_ridge_pulls_toward_neutral():
    premultiplied, alpha, target = drawn()
    base = np.concatenate([premultiplied, alpha[:, None]], 1)
    for ridge in (1e-3, 1.0):
        # the ridge as additional rows of an ordinary least squares problem
        rows = np.concatenate([base, np.sqrt(ridge * 400) * np.eye(4)])
        right = np.concatenate([target, np.sqrt(ridge * 400) * np.eye(4, 3)])
        found = fit_color(premultiplied, alpha, target, ridge=ridge)
        assert np.allclose(found.T, np.linalg.lstsq(rows, right, rcond=None)[0], atol=1e-9)
    assert torch.allclose(fit_color(premultiplied, alpha, target, ridge=1e9), neutral(), atol=1e-6)


def test_what_the_colors_do_not_determine_stays_neutral():
    gray = torch.full((50, 3), 0.5)
    found = fit_color(gray, torch.ones(50), gray)
    assert torch.allclose(found, neutral(), atol=1e-9)
    assert torch.allclose(fit_color(gray[:0], torch.ones(0), gray[:0]), neutral())


def test_the_fitted_matrix_brings_the_drawing_to_the_target():
    premultiplied, alpha, _ = drawn()
    matrix = torch.tensor([[0.9, 0.1, 0, 0.02], [0, 1.2, -0.1, 0], [0.05, 0, 0.8, -0.03]], dtype=torch.float64)
    image = premultiplied.view(20, 20, 3)
    target = correct_color(image, alpha.view(20, 20), matrix)
    # applied to the color itself, before it is multiplied with alpha
    color = premultiplied / alpha[:, None]
    assert torch.allclose(target.view(-1, 3), (color @ matrix[:, :3].T + matrix[:, 3]) * alpha[:, None])
    assert torch.allclose(fit_color(image, alpha.view(20, 20), target), matrix, atol=1e-9)


def test_uncorrected_is_the_inverse():
    matrix = torch.tensor([[0.9, 0.1, 0, 0.02], [0, 1.2, -0.1, 0], [0.05, 0, 0.8, -0.03]], dtype=torch.float64)
    colors = torch.rand(5, 7, 3, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    seen = np.concatenate([colors.numpy(), np.ones((5, 7, 1))], -1) @ matrix.numpy().T
    assert torch.allclose(uncorrected(torch.from_numpy(seen), matrix), colors, atol=1e-12)
    assert torch.allclose(correct_color(uncorrected(colors, matrix), torch.ones(5, 7), matrix), colors, atol=1e-12)
