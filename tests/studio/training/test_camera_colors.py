"""Colors of cameras: a rig whose cameras differ by known matrices."""

from __future__ import annotations

from collections.abc import Collection

import pytest
import torch

from studio.cameras import Camera
from studio.color_fit import correct_color, neutral
from studio.rasterizer import rasterize
from studio.training import LearningRates, TrainingView, TrainSettings, fit_camera_colors
from studio.training.camera_colors import camera_colors
from studio.training.step import Stepper
from studio.vignette import Vignette
from tests.studio.training.test_group import HEIGHT, WIDTH, ball, cameras

SETTINGS = TrainSettings(
    camera_color_iterations=100,
    camera_color_every=20,
    rates=LearningRates(sh_dc=0.005),
    scale_reg=0.0,
    opacity_reg=0.0,
    dropout=0.0,
)


def matrices() -> torch.Tensor:
    """(8, 3, 4): gains and offsets of each camera, neutral in the mean."""
    generator = torch.Generator().manual_seed(1)
    gains = 0.15 * torch.randn(8, 3, generator=generator, dtype=torch.float64)
    found = torch.zeros(8, 3, 4, dtype=torch.float64)
    found[:, range(3), range(3)] = gains
    found[:, :, 3] = 0.03 * torch.randn(8, 3, generator=generator, dtype=torch.float64)
    return found - found.mean(0) + neutral()


def darker_corners(camera: Camera) -> torch.Tensor:
    """(H, W, 1) an exact vignette: 90% of the light is lost at half the diagonal of the image, and 6% at the edge of
    the ball."""
    rows = torch.arange(HEIGHT)[:, None] + 0.5 - camera.cy
    columns = torch.arange(WIDTH)[None] + 0.5 - camera.cx
    distance = torch.hypot(rows, columns) / (0.5 * (WIDTH**2 + HEIGHT**2) ** 0.5)
    return (1 - 0.9 * distance**2)[..., None].float()


def filmed(plate: torch.Tensor | None = None, vignetted: Collection[int] = ()) -> list[TrainingView]:
    """The ball by cameras with these matrices, before a plate or cut out; some of them with `darker_corners`."""
    made = []
    for number, (camera, matrix) in enumerate(zip(cameras(), matrices(), strict=True)):
        render = rasterize(ball(torch.zeros(3)), camera, torch.zeros(3))
        image = correct_color(render.image, render.alpha, matrix)
        if number in vignetted:
            image = image * darker_corners(camera)
        if plate is None:
            made.append(
                TrainingView(camera, image / render.alpha[..., None].clamp_min(1e-3), render.alpha, (WIDTH, HEIGHT))
            )
        else:
            over = image + (1 - render.alpha)[..., None] * plate
            made.append(TrainingView(camera, over, render.alpha, (WIDTH, HEIGHT), plate))
    return made


@pytest.mark.parametrize("with_plate", [False, True])
def test_the_matrices_of_the_cameras_are_found_on_exact_splats(with_plate: bool) -> None:
    generator = torch.Generator().manual_seed(3)
    plate = torch.rand(HEIGHT, WIDTH, 3, generator=generator) if with_plate else None
    found = camera_colors(ball(torch.zeros(3)), filmed(plate)).matrices
    assert torch.allclose(found.mean(0), neutral(), atol=1e-12), "the mean camera is neutral"
    colors = torch.tensor([[0.2, 0.5, 0.8, 1.0], [0.9, 0.4, 0.1, 1.0]], dtype=torch.float64).T
    assert (found @ colors - matrices() @ colors).abs().max() < 0.02
    assert ((neutral() - matrices()) @ colors).abs().max() > 0.15, "what is left without it"


@pytest.mark.parametrize("with_plate", [False, True])
def test_the_cameras_with_a_vignette_are_found_on_exact_splats(with_plate: bool) -> None:
    generator = torch.Generator().manual_seed(3)
    plate = torch.rand(HEIGHT, WIDTH, 3, generator=generator) if with_plate else None
    seen = filmed(plate, vignetted=(1, 4))
    found = camera_colors(ball(torch.zeros(3)), seen)
    assert [number for number, one in enumerate(found.vignettes) if one is not None] == [1, 4]
    colors = torch.tensor([[0.2, 0.5, 0.8, 1.0], [0.9, 0.4, 0.1, 1.0]], dtype=torch.float64).T
    for number in (1, 4):
        inside = seen[number].mask > 0.99
        vignette = found.vignettes[number]
        assert vignette is not None
        gain = vignette.gain(seen[number].camera, (WIDTH, HEIGHT))
        assert (gain - darker_corners(seen[number].camera)[..., 0])[inside].abs().max() < 0.01
        assert gain[inside].min() < 0.95, "what is found is not small"
    assert (found.matrices @ colors - matrices() @ colors).abs().max() < 0.02
    assert camera_colors(ball(torch.zeros(3)), seen, vignettes=False).vignettes == (None,) * 8


def test_a_vignette_is_seen_by_cut_out_and_by_smaller_views_as_well() -> None:
    camera = cameras()[0]
    seen = filmed(vignetted=(0,))[0].with_color(matrices()[0], Vignette(-0.9, 0.0, 1.0))
    black = torch.zeros(3)
    drawn = rasterize(ball(torch.zeros(3)), camera, black)
    truth = seen.composited(black)
    assert (seen.in_its_colors(drawn.image, drawn.alpha, black) - truth).abs().max() < 0.01

    half = seen.half_size()
    assert half.vignette is not None
    gain = half.vignette.gain(half.camera, half.full_size)
    expected = torch.nn.functional.avg_pool2d(darker_corners(camera)[None, ..., 0], 2)[0]
    assert (gain - expected).abs().max() < 2e-3
    # a crop sees its part of the image
    left, top, width, height = 5, 3, WIDTH // 2, HEIGHT // 2
    part = seen.vignette.gain(camera.cropped(left, top, width, height), (WIDTH, HEIGHT))  # type: ignore[union-attr]
    assert torch.allclose(part, darker_corners(camera)[top : top + height, left : left + width, 0], atol=1e-6)


def test_a_step_compares_the_splats_in_the_colors_of_the_camera() -> None:
    generator = torch.Generator().manual_seed(3)
    plate = torch.rand(HEIGHT, WIDTH, 3, generator=generator)
    for seen in (filmed(), filmed(plate)):
        with_colors = [view.with_color(one) for view, one in zip(seen, matrices(), strict=True)]
        losses = []
        for views in (seen, with_colors):
            stepper = Stepper(views, SETTINGS.replace(background="black"), torch.Generator().manual_seed(0))
            losses.append(sum(float(stepper(ball(torch.zeros(3))).loss) for _ in views))
        assert losses[1] < 0.05 * losses[0]
        refined = with_colors[0].with_mask(with_colors[0].mask)
        assert torch.equal(refined.color, with_colors[0].color), "new masks keep the colors"


def test_cameras_are_fitted_while_splats_learn_from_points() -> None:
    truth, views = ball(torch.zeros(3)), filmed()
    start = truth.sh[:, 0] * 0.28209479 * 0.8 + 0.5  # as points, whose colors are those of the images, a bit blurred
    steps = []

    def progress(done: int, total: int, **figures: float) -> None:
        steps.append((done, total))

    fitted = fit_camera_colors(views, truth.means, start, SETTINGS, seed=5, progress=progress)
    found = fitted.matrices
    assert steps[-1] == (100, 100)
    assert torch.allclose(found.mean(0), neutral(), atol=1e-12)
    colors = torch.tensor([[0.3, 0.5, 0.7, 1.0], [0.7, 0.4, 0.2, 1.0]], dtype=torch.float64).T
    error = ((found - matrices()) @ colors).square().mean().sqrt()
    assert error < 0.6 * ((neutral() - matrices()) @ colors).square().mean().sqrt()
    again = fit_camera_colors(views, truth.means, start, SETTINGS, seed=5)
    assert torch.equal(found, again.matrices)
    assert fitted.vignettes == again.vignettes
