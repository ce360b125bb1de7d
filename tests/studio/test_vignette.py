"""The fall of brightness toward the corners."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from studio.cameras import Camera
from studio.color_fit import neutral
from studio.vignette import Vignette, fit_color_and_vignette, radius_squared

WIDTH, HEIGHT = 80, 60


def camera() -> Camera:
    K = np.array([[90.0, 0, 36.0], [0, 90.0, 33.0], [0, 0, 1]])
    return Camera("cam", WIDTH, HEIGHT, K, np.eye(4))


def test_the_radius_is_1_at_half_the_diagonal() -> None:
    r2 = radius_squared(camera(), (WIDTH, HEIGHT))
    assert r2.shape == (HEIGHT, WIDTH)
    assert float(r2[32, 35]) == pytest.approx(0.5 / 2500)  # half a pixel in x and y; half the diagonal is 50 px
    assert float(r2[32, 75]) == pytest.approx((39.5**2 + 0.5**2) / 2500)


@pytest.mark.parametrize(("a", "b"), [(-0.3, 0.0), (-0.1, -0.35), (-0.4, 0.15), (0.0, 0.0)])
def test_a_known_vignette_is_found_through_noise(a: float, b: float) -> None:
    generator = torch.Generator().manual_seed(1)
    colors = torch.rand(HEIGHT, WIDTH, 3, generator=generator)
    y, x = torch.meshgrid(torch.arange(HEIGHT) + 0.5 - 33, torch.arange(WIDTH) + 0.5 - 36, indexing="ij")
    r2 = (x**2 + y**2) / 2500
    truth = 1 + a * r2 + b * r2**2
    matrix = torch.tensor([[0.8, 0.1, 0.0, 0.02], [0.0, 1.1, 0.05, 0.0], [0.1, 0.0, 0.9, -0.03]])
    filmed = (colors @ matrix[:, :3].T + matrix[:, 3]) * truth[..., None]
    filmed = filmed + 0.02 * torch.randn(HEIGHT, WIDTH, 3, generator=generator)
    weights = torch.zeros(HEIGHT, WIDTH)
    weights[10:55, 8:70] = 1
    filmed[weights == 0] = 7.0  # not looked at
    r2_of_camera = radius_squared(camera(), (WIDTH, HEIGHT))
    found_matrix, found = fit_color_and_vignette(colors, torch.ones(HEIGHT, WIDTH), filmed, r2_of_camera, weights, 1e-6)
    gain = found.gain(camera(), (WIDTH, HEIGHT))
    assert (gain - truth)[weights > 0].abs().max() < 0.01
    assert (found_matrix - matrix).abs().max() < 0.01
    assert found.reach == pytest.approx(float(r2[weights > 0].max()))


def test_a_rise_toward_the_corners_is_no_vignette() -> None:
    colors = torch.rand(HEIGHT, WIDTH, 3, generator=torch.Generator().manual_seed(1))
    r2 = radius_squared(camera(), (WIDTH, HEIGHT))
    ones = torch.ones(HEIGHT, WIDTH)
    _, found = fit_color_and_vignette(colors, ones, colors * (1 + 0.3 * r2)[..., None].float(), r2, ones, 1e-6)
    assert (found.a, found.b) == (0, 0)
    # a rise in the middle, a fall outside: on the whole a fall, by one term
    hump = (1 + 0.2 * r2 - 0.5 * r2**2)[..., None].float()
    _, found = fit_color_and_vignette(colors, ones, colors * hump, r2, ones, 1e-6)
    assert found.a < 0
    assert found.b == 0


def test_further_out_than_it_was_fitted_it_stays_what_it_is() -> None:
    gain = Vignette(-0.5, 0.0, 0.25).gain_at(torch.tensor([0.0, 0.1, 0.25, 0.3, 1.0]))
    assert torch.allclose(gain, torch.tensor([1.0, 0.95, 0.875, 0.875, 0.875]))


def test_without_pixels_it_changes_nothing() -> None:
    nothing = torch.zeros(HEIGHT, WIDTH)
    color = torch.rand(HEIGHT, WIDTH, 3)
    matrix, found = fit_color_and_vignette(color, nothing, color, nothing, nothing, 1e-3)
    assert torch.equal(matrix, neutral())
    assert torch.equal(found.gain(camera(), (WIDTH, HEIGHT)), torch.ones(HEIGHT, WIDTH))
