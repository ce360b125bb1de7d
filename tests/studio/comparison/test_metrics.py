"""Measures against OpenCV and NumPy, and the protocols."""

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
import torch

from tests.support.rigs import camera_at
from tests.support.splats import round_splats
from v3studio.studio.cameras import Camera
from v3studio.studio.comparison import Behind, ViewPair, find_camera, measure, padded_box
from v3studio.studio.gaussians import Gaussians
from v3studio.studio.rasterizer import rasterize

WIDTH, HEIGHT = 64, 48


def splats(color: tuple[float, float, float] = (0.2, 0.5, 0.7)) -> Gaussians:
    """A blob in front of the camera, with some variation of color."""
    generator = torch.Generator().manual_seed(0)
    means = torch.randn(300, 3, generator=generator) * 0.2
    sh = (torch.tensor(color) + 0.2 * torch.randn(300, 3, generator=generator) - 0.5)[:, None] / 0.28209479
    return replace(round_splats(means, -2.5, 0.95), sh=sh)


def camera() -> Camera:
    return camera_at("cam", (0, 0, -2), focal=70.0, size=(WIDTH, HEIGHT), up=(0, -1, 0))


def filmed(change: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Image and mask of the splats, by a camera with other colors, (3, 4)."""
    image = rasterize(splats(), camera(), torch.zeros(3)).image.numpy()
    mask = (image.sum(-1) > 0.15).astype(np.uint8) * 255
    if change is not None:
        image = image @ change[:, :3].T + change[:, 3]
    return (np.clip(image, 0, 1) * 255 + 0.5).astype(np.uint8), mask


@pytest.mark.parametrize("background", [(0.0, 0.0, 0.0), (1.0, 1.0, 1.0)])
def test_psnr_is_that_of_opencv_over_the_background(background: tuple[float, float, float]) -> None:
    image, mask = filmed()
    noise = np.random.default_rng(0).integers(-20, 20, image.shape)
    noisy = np.clip(image.astype(int) + noise, 0, 255).astype(np.uint8)
    pair = ViewPair.of(splats(), camera(), noisy, mask, background)
    truth = np.where(mask[..., None] > 0, noisy / 255, np.array(background))
    assert np.allclose(pair.footage, truth, atol=1e-6)
    measures = measure(pair)
    assert measures["psnr"] == pytest.approx(cv2.PSNR(truth, pair.rendered.astype(float), 1.0), abs=1e-3)
    rows, columns = padded_box(mask, 8)
    box = measure(ViewPair.of(splats(), camera(), noisy, mask, background, (rows, columns)))
    expected = cv2.PSNR(truth[rows, columns], pair.rendered[rows, columns].astype(float), 1.0)
    assert box["psnr"] == pytest.approx(expected, abs=1e-3)
    # outside the box all is background, so both have the same squared error in total
    ratio = WIDTH * HEIGHT / ((rows.stop - rows.start) * (columns.stop - columns.start))
    assert measures["psnr"] - box["psnr"] == pytest.approx(10 * math.log10(ratio), abs=0.05)


def test_thin_performers_have_no_interior() -> None:
    image, mask = filmed()
    thin = np.zeros_like(mask)
    thin[:, 30:33] = 255
    measures = measure(ViewPair.of(splats(), camera(), image, thin, (0, 0, 0)))
    assert "psnr_interior" not in measures
    assert "psnr_outline" in measures


def test_a_color_fit_finds_the_colors_of_another_camera_but_no_detail() -> None:
    change = np.array([[0.9, 0.05, 0, 0.02], [0, 1.1, 0, -0.03], [0.03, 0, 0.8, 0.04]])
    image, mask = filmed(change)
    pair = ViewPair.of(splats(), camera(), image, mask, (0, 0, 0), fit=True)
    measures = measure(pair)
    assert measures["psnr"] < 32
    assert measures["psnr_color_fit"] > measures["psnr"] + 3
    inside = mask > 127
    # plain least squares on the performer, by NumPy
    render = rasterize(splats(), camera(), torch.zeros(3))
    base = np.concatenate([render.image.numpy(), render.alpha.numpy()[..., None]], -1)
    matrix = np.linalg.lstsq(base[inside], pair.footage[inside], rcond=None)[0]
    assert np.allclose(pair.fitted, np.clip(base @ matrix, 0, 1), atol=1e-4)


def test_lpips_gets_images_of_its_smallest_size() -> None:
    black = np.zeros((20, 20, 3), np.float32)
    small = ViewPair(black, black, (1, 1, 1), (slice(0, 20), slice(0, 20)), np.zeros((20, 20), np.float32))
    sizes = []

    def metric(one, other):
        sizes.append((tuple(one.shape), float(one[-1, -1, 0])))
        return 0.25

    assert measure(small, metric)["lpips"] == 0.25
    assert sizes == [((32, 32, 3), 1.0)]
    assert "lpips" not in measure(small)


def test_cameras_are_found_by_number_if_only_one_has_it() -> None:
    assert find_camera("48", ["cam047", "cam048"]) == "cam048"
    assert find_camera("cam00", ["0", "1"]) == "0"
    assert find_camera("48", ["a48", "b48"]) is None
    assert find_camera("48", ["a48", "48"]) == "48"
    assert find_camera("left", ["right"]) is None


def test_uncut_figures_count_what_the_mask_lost() -> None:
    image, mask = filmed()
    room = np.full((*mask.shape, 3), 0.3, np.float32)
    alpha = rasterize(splats(), camera(), torch.zeros(3)).alpha.numpy()[..., None]
    uncut = (np.clip(image / 255 + (1 - alpha) * room, 0, 1) * 255 + 0.5).astype(np.uint8)
    upper = np.arange(HEIGHT)[:, None] < HEIGHT // 2
    cut = np.where(upper, mask, 0).astype(np.uint8)
    means = splats().means[:, 1]
    half = splats()[means < means.median()]  # the image's y axis points down, as the world's
    behind = Behind(room, mask > 127)
    found = {
        name: measure(ViewPair.of(gaussians, camera(), uncut, cut, (0, 0, 0), padded_box(cut, 8), behind=behind))
        for name, gaussians in {"all": splats(), "half": half}.items()
    }
    assert found["half"]["psnr"] > found["all"]["psnr"] - 3, "the mask's own figures do not see what is missing"
    for name in ("psnr_performer", "psnr_moving", "psnr_picture"):
        assert found["all"][name] > found["half"][name] + 6
    rendered = ViewPair.of(half, camera(), uncut, cut, (0, 0, 0), behind=behind).uncut
    assert rendered is not None
    truth = cv2.PSNR(uncut / 255, rendered.rendered.astype(float), 1.0)
    assert found["half"]["psnr_picture"] == pytest.approx(truth, abs=1e-3)


def test_a_set_of_splats_is_drawn_with_the_performer_and_its_colors_may_be_fitted() -> None:
    _, mask = filmed()
    scene = splats().clone()
    scene.means = scene.means * 3 + torch.tensor([0.0, 0.0, 2.0])  # around and behind
    scene.log_scales = scene.log_scales + 2
    both = rasterize(Gaussians.cat(scene, splats()), camera(), torch.zeros(3)).image.clamp(0, 1)
    darker = (both * 0.7 * 255 + 0.5).to(torch.uint8).numpy()
    back = Behind(np.ones((*mask.shape, 3), np.float32), mask > 127, scene)
    for image, fits in (((both * 255 + 0.5).to(torch.uint8).numpy(), True), (darker, False)):
        pair = ViewPair.of(splats(), camera(), image, mask, (0, 0, 0), behind=back)
        found = measure(pair, masked=False)
        assert set(found) == {"psnr_performer", "psnr_moving", "psnr_picture", "psnr_picture_fitted"}
        assert found["psnr_picture_fitted"] > 45
        assert (found["psnr_picture"] > 45) == fits
