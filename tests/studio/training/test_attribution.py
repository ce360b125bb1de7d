"""Each pixel's weight and error are divided among the splats that it shows."""

from __future__ import annotations

import numpy as np
import torch

from studio.cameras import Camera
from studio.gaussians import SH_C0, Gaussians
from studio.rasterizer import rasterize
from studio.training import TrainingView
from studio.training.attribution import picture_error, shares

SIZE = 48
CAMERA = Camera("a", SIZE, SIZE, np.array([[48.0, 0, 24], [0, 48.0, 24], [0, 0, 1]]), np.eye(4))


def splats(colors: list[float], places: list[tuple[float, float, float]], opacity: float = 0.8) -> Gaussians:
    count = len(places)
    quats = torch.tensor([[1.0, 0, 0, 0]]).repeat(count, 1)
    sh = ((torch.tensor(colors) - 0.5) / SH_C0)[:, None, None].repeat(1, 1, 3)
    logits = torch.logit(torch.full((count,), opacity))
    return Gaussians(torch.tensor(places), quats, torch.full((count, 3), -2.5), logits, sh)


def view(image: torch.Tensor, mask: torch.Tensor | None = None) -> TrainingView:
    return TrainingView(CAMERA, image, torch.ones(SIZE, SIZE) if mask is None else mask, (SIZE, SIZE))


def apart() -> Gaussians:
    return splats([0.6, 0.6, 0.6], [(-0.5, 0.0, 2.0), (0.5, 0.0, 2.0), (0.5, 0.1, 3.0)])


def test_the_weights_of_all_splats_add_up_to_the_drawn_coverage() -> None:
    seen = apart()
    found = shares(seen, [view(torch.zeros(SIZE, SIZE, 3))] * 2)
    coverage = float(rasterize(seen, CAMERA).alpha.double().sum())
    assert abs(float(found.weight.double().sum()) / 2 - coverage) < 1e-3 * coverage
    alone = float(rasterize(seen[torch.tensor([0])], CAMERA).alpha.sum())
    assert abs(float(found.weight[0]) / 2 - alone) < 1e-3 * alone
    assert float(found.weight[2]) < float(found.weight[1]), "the second one is in front of it"


def test_the_splat_with_another_color_than_the_footage_has_the_error() -> None:
    truth = splats([0.6, 0.2], [(-0.5, 0.0, 2.0), (0.5, 0.0, 2.0)])
    image = rasterize(truth, CAMERA, torch.full((3,), 0.5)).image.detach()
    wrong = splats([0.6, 0.6], [(-0.5, 0.0, 2.0), (0.5, 0.0, 2.0)])
    found = shares(wrong, [view(image)])
    assert float(found.error[0]) < 1e-4
    # the error is 0.4 where the splat covers all, and the weight w gives 0.4 w there: the sum of 0.4 w^2
    weight = rasterize(truth[torch.tensor([1])], CAMERA).alpha.double()
    assert abs(float(found.error[1]) - 0.4 * float((weight**2).sum())) < 1e-3 * float(found.error[1])


def test_errors_at_the_outline_do_not_count() -> None:
    mask = torch.zeros(SIZE, SIZE)
    mask[10:30, 10:30] = 1
    empty = splats([0.5], [(0.0, 0.0, -1.0)])
    error = picture_error(empty, view(torch.ones(SIZE, SIZE, 3), mask))
    assert torch.equal(error > 0, torch.nn.functional.pad(torch.ones(16, 16), (12, 20, 12, 20)) > 0)
    assert torch.allclose(error[12:28, 12:28], torch.tensor(0.5))


def test_the_colors_of_a_camera_are_not_an_error() -> None:
    seen = apart()
    image = rasterize(seen, CAMERA, torch.full((3,), 0.5)).image.detach()
    darker = image - 0.3 * (image - 0.5 * (1 - rasterize(seen, CAMERA).alpha[..., None].detach()))
    plain = picture_error(seen, view(darker))
    colored = picture_error(seen, view(darker).with_color(0.7 * torch.eye(3, 4)))
    assert float(plain.max()) > 0.1
    assert float(colored.max()) < 1e-5


def test_large_views_are_the_same(monkeypatch) -> None:  # type: ignore[no-untyped-def]
    """Views above `CACHED_PIXELS` are stored as bytes."""
    monkeypatch.setattr("studio.training.views.CACHED_PIXELS", 0)
    image = torch.full((SIZE, SIZE, 3), 128, dtype=torch.uint8)
    stored = TrainingView(CAMERA, image, torch.full((SIZE, SIZE), 255, dtype=torch.uint8), (SIZE, SIZE))
    floats = view(image / 255)
    assert torch.allclose(picture_error(apart(), stored), picture_error(apart(), floats))
