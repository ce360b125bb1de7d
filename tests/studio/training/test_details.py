"""Details: boxes against points on the ball, the loss against weights of pixels, and where splats go."""

import numpy as np
import pytest
import torch

from tests.support.rigs import camera_at
from tests.support.splats import round_splats
from v3studio.studio.footage import FootageView
from v3studio.studio.rasterizer import rasterize
from v3studio.studio.training import Detail, TrainingView, TrainSettings
from v3studio.studio.training.details import DetailBox, detail_boxes, detail_loss, detail_weights
from v3studio.studio.training.photometric import photometric_loss
from v3studio.studio.training.step import Stepper


def line(count: int) -> torch.Tensor:
    """(count, 3) points with x = 0, 1, ..."""
    return torch.nn.functional.pad(torch.arange(count).float()[:, None], (0, 2))


def test_the_box_is_around_the_ball() -> None:
    camera = camera_at("cam0", np.array([3.0, -0.4, 0.3]), size=(160, 120))
    center, radius = np.array([0.1, -0.2, 0.05]), 0.3
    (box,) = detail_boxes(camera, [Detail(tuple(center.tolist()), radius, 3.0)])
    # the disk of the ball that faces the camera
    eye = np.linalg.inv(camera.world_to_camera)
    turns = np.linspace(0, 2 * np.pi, 400)[:, None]
    pixels, _ = camera.project(center + radius * (np.cos(turns) * eye[:3, 0] + np.sin(turns) * eye[:3, 1]))
    low, high = pixels.min(0), pixels.max(0)
    assert np.abs(np.array([box.left, box.top]) - low).max() < 1.1
    assert np.abs(np.array([box.right, box.bottom]) - high).max() < 1.1
    assert box.weight == 3.0


def test_a_detail_behind_or_beside_the_camera_has_no_box() -> None:
    camera = camera_at("cam0", np.array([3.0, 0.0, 0.0]))
    assert detail_boxes(camera, [Detail((6.0, 0.0, 0.0), 0.3, 2.0), Detail((0.0, 500.0, 0.0), 0.3, 2.0)]) == ()


def test_weights_are_those_of_pixels() -> None:
    generator = torch.Generator().manual_seed(0)
    image, target = torch.rand(2, 20, 30, 3, generator=generator, dtype=torch.float64)
    boxes = [DetailBox(3, 2, 13, 9, 4.0), DetailBox(20, 10, 30, 20, 2.5)]
    weights = torch.ones(20, 30, dtype=torch.float64)
    weights[2:9, 3:13], weights[10:20, 20:30] = 4.0, 2.5
    expected = (weights[..., None] * (image - target).abs()).mean()
    found = photometric_loss(image, target, 0.0) + sum(detail_loss(image, target, box, 0.0) for box in boxes)
    assert torch.allclose(found, expected, atol=1e-12)


def test_a_step_compares_the_closer_view(large_view: TrainingView) -> None:
    """Its loss is that of the whole image and that of the box, each of its own drawing."""
    settings = TrainSettings(background="black", dropout=0.0, dssim_weight=0.2)
    gaussians = round_splats(line(3), -4.6)
    step = Stepper([large_view], settings, torch.Generator().manual_seed(0))(gaussians)
    (box,), (closer,) = large_view.detail_boxes, large_view.closer
    whole, near = (rasterize(gaussians, one.camera) for one in (large_view, closer))
    losses = [
        photometric_loss(one.image, view.over(torch.zeros(3))[0], 0.2)
        for one, view in ((whole, large_view), (near, closer))
    ]
    share = (box.right - box.left) * (box.bottom - box.top) / whole.alpha.numel()
    assert torch.allclose(step.loss, losses[0] + (box.weight - 1) * share * losses[1], atol=1e-6)


def test_a_closer_view_shows_the_box_in_more_pixels(large_view: TrainingView) -> None:
    (box,), (closer,) = large_view.detail_boxes, large_view.closer
    assert (closer.camera.width, closer.camera.height) == (3 * (box.right - box.left), 3 * (box.bottom - box.top))
    # a point of the world is at the same place of the box
    point = np.array([[0.02, 0.05, -0.03]])
    far, near = (one.camera.project(point)[0][0] for one in (large_view, closer))
    assert np.allclose(3 * (far - (box.left, box.top)), near, atol=1e-6)


@pytest.fixture
def large_view() -> TrainingView:
    """A crop of a third of the pixels of a noisy image, with a detail."""
    large = camera_at("cam0", np.array([3.0, 0.0, 0.0]), size=(180, 120))
    generator = np.random.default_rng(0)
    image = generator.integers(0, 255, (120, 180, 3), dtype=np.uint8)
    mask = np.full((120, 180), 255, np.uint8)
    small = image.reshape(40, 3, 60, 3, 3).mean((1, 3)).astype(np.uint8)
    view = FootageView(large.resized(60, 40), small, mask[::3, ::3])
    whole = TrainingView.from_view(view, box=(10, 5, 40, 30))
    details = (Detail((0.0, 0.0, 0.0), 0.3, 4.0),)
    return whole.with_details(details).with_closer(FootageView(large, image, mask))


def test_a_splat_has_the_weight_of_the_heaviest_detail_around_it() -> None:
    details = [Detail((1.0, 0, 0), 1.1, 3.0), Detail((2.0, 0, 0), 0.5, 5.0), Detail((2.0, 0, 0), 0.6, 2.0)]
    assert detail_weights(line(5), details).tolist() == [3, 3, 5, 1, 1]
