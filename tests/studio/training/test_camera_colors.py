"""Colors of cameras: a rig whose cameras differ by known matrices."""

import pytest
import torch

from tests.studio.training.test_group import HEIGHT, WIDTH, ball, cameras
from v3studio.studio.color_fit import correct_color, neutral
from v3studio.studio.rasterizer import rasterize
from v3studio.studio.training import LearningRates, TrainingView, TrainSettings, fit_camera_colors
from v3studio.studio.training.camera_colors import camera_colors

SETTINGS = TrainSettings(rates=LearningRates(sh_dc=0.005), scale_reg=0.0, opacity_reg=0.0, dropout=0.0)


def matrices() -> torch.Tensor:
    """(8, 3, 4): gains and offsets of each camera, neutral in the mean."""
    generator = torch.Generator().manual_seed(1)
    gains = 0.15 * torch.randn(8, 3, generator=generator, dtype=torch.float64)
    found = torch.zeros(8, 3, 4, dtype=torch.float64)
    found[:, range(3), range(3)] = gains
    found[:, :, 3] = 0.03 * torch.randn(8, 3, generator=generator, dtype=torch.float64)
    return found - found.mean(0) + neutral()


def filmed(plate: torch.Tensor | None = None) -> list[TrainingView]:
    """The ball by cameras with these matrices, before a plate or cut out."""
    made = []
    for camera, matrix in zip(cameras(), matrices(), strict=True):
        render = rasterize(ball(torch.zeros(3)), camera, torch.zeros(3))
        image = correct_color(render.image, render.alpha, matrix)
        alpha = render.alpha[..., None]
        seen = image / alpha.clamp_min(1e-3) if plate is None else image + (1 - alpha) * plate
        made.append(TrainingView(camera, seen, render.alpha, plate))
    return made


@pytest.mark.parametrize("with_plate", [False, True])
def test_the_matrices_of_the_cameras_are_found_on_exact_splats(with_plate: bool) -> None:
    generator = torch.Generator().manual_seed(3)
    plate = torch.rand(HEIGHT, WIDTH, 3, generator=generator) if with_plate else None
    found = camera_colors(ball(torch.zeros(3)), filmed(plate))
    assert torch.allclose(found.mean(0), neutral(), atol=1e-12), "the mean camera is neutral"
    colors = torch.tensor([[0.2, 0.5, 0.8, 1.0], [0.9, 0.4, 0.1, 1.0]], dtype=torch.float64).T
    assert (found @ colors - matrices() @ colors).abs().max() < 0.02
    assert ((neutral() - matrices()) @ colors).abs().max() > 0.15, "what is left without it"


def test_cameras_are_fitted_while_splats_learn_from_points(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("v3studio.studio.training.camera_colors.STEPS", 100)
    monkeypatch.setattr("v3studio.studio.training.camera_colors.EVERY", 20)
    truth, views = ball(torch.zeros(3)), filmed()
    start = truth.sh[:, 0] * 0.28209479 * 0.8 + 0.5  # as points, whose colors are those of the images, a bit blurred
    steps = []
    told = lambda done, total, **_: steps.append((done, total))  # noqa: E731
    found = fit_camera_colors(views, truth.means, start, SETTINGS, seed=5, progress=told)
    assert steps[-1] == (100, 100)
    assert torch.allclose(found.mean(0), neutral(), atol=1e-12)
    colors = torch.tensor([[0.3, 0.5, 0.7, 1.0], [0.7, 0.4, 0.2, 1.0]], dtype=torch.float64).T
    error = ((found - matrices()) @ colors).square().mean().sqrt()
    assert error < 0.6 * ((neutral() - matrices()) @ colors).square().mean().sqrt()
    monkeypatch.setattr("v3studio.studio.training.camera_colors.STEPS", 25)
    assert torch.equal(*(fit_camera_colors(views, truth.means, start, SETTINGS, seed=5) for _ in range(2)))
