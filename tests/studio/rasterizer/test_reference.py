"""The reference implementation against closed forms, sampling and finite differences."""

import math

import numpy as np
import pytest
import torch

from tests.studio.rasterizer.conftest import make_camera, make_splats
from v3studio.studio.cameras import Camera
from v3studio.studio.gaussians import SH_C0, Gaussians
from v3studio.studio.rasterizer import rasterize
from v3studio.studio.rasterizer.reference import project
from v3studio.studio.rasterizer.spherical_harmonics import sh_basis

AHEAD = Camera("ahead", 21, 15, np.array([[30.0, 0, 10.5], [0, 30.0, 7.5], [0, 0, 1]]), np.eye(4))


def ball(z: float, scale: float, opacity: float, color: tuple[float, float, float], dilation: float = 0.3) -> Gaussians:
    """An isotropic splat of one color on the optical axis of `AHEAD`."""
    one = torch.ones(1, dtype=torch.float64)
    return Gaussians(
        means=torch.tensor([[0.0, 0.0, z]], dtype=torch.float64),
        quats=torch.tensor([[1.0, 0, 0, 0]], dtype=torch.float64),
        log_scales=torch.full((1, 3), math.log(scale), dtype=torch.float64),
        logit_opacities=torch.logit(one * opacity) if opacity < 1 else one * math.inf,
        sh=(torch.tensor(color, dtype=torch.float64).view(1, 1, 3) - 0.5) / SH_C0,
        dilation=dilation,
    )


def draw(splats: Gaussians, **options: object) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    render = rasterize(splats, AHEAD, backend="reference", **options)  # type: ignore[arg-type]
    return render.image, render.alpha, render.depth


def expected_alpha(z: float, scale: float, opacity: float, dilation: float = 0.3) -> np.ndarray:
    variance = (30.0 * scale / z) ** 2 + dilation
    y, x = np.mgrid[0:15, 0:21] + 0.5
    alpha = np.minimum(opacity * np.exp(-((x - 10.5) ** 2 + (y - 7.5) ** 2) / (2 * variance)), 0.99)
    return np.where(alpha < 1 / 255, 0, alpha)


@pytest.mark.parametrize("backend", ["reference", "cpu"])
@pytest.mark.parametrize("dilation", [0.02, 0.1, 0.3, 1.0])
def test_a_ball_over_the_background_and_its_gradient_have_a_closed_form(dilation: float, backend: str) -> None:
    """alpha = o exp(-r^2 / 2v) with v = (f s / z)^2 + dilation, so its derivative by log s is
    alpha r^2 (v - dilation) / v^2, summed over the three scales; the one along the view has none."""
    splat = ball(2.0, 0.05, 0.8, (1.0, 0.25, 0.0), dilation).map(lambda tensor: tensor.requires_grad_())
    background = torch.tensor([0.1, 0.2, 0.9], dtype=torch.float64)
    render = rasterize(splat, AHEAD, background, backend=backend)
    a = expected_alpha(2.0, 0.05, 0.8, dilation)
    np.testing.assert_allclose(render.alpha.detach(), a, atol=1e-12)
    expected = np.array([1.0, 0.25, 0.0]) * a[..., None] + (1 - a[..., None]) * background.numpy()
    np.testing.assert_allclose(render.image.detach(), expected, atol=1e-12)
    np.testing.assert_allclose(render.depth.detach(), np.where(a > 0, 2.0, 0.0), atol=1e-12)
    render.alpha.sum().backward()
    size = (30.0 * 0.05 / 2.0) ** 2
    y, x = np.mgrid[0:15, 0:21] + 0.5
    square = (x - 10.5) ** 2 + (y - 7.5) ** 2
    expected = (a * square * size / (size + dilation) ** 2).sum()
    assert float(splat.log_scales.grad.sum()) == pytest.approx(expected, rel=1e-9)
    assert float(render.radii[0]) == pytest.approx(math.sqrt(2 * math.log(0.8 * 255) * (size + dilation)))


def test_a_nearer_splat_occludes_a_farther_one_in_either_order() -> None:
    near, far = ball(2.0, 0.1, 0.6, (1, 0, 0)), ball(3.0, 0.4, 0.9, (0, 0, 1))
    a, b = expected_alpha(2.0, 0.1, 0.6), expected_alpha(3.0, 0.4, 0.9)
    for splats in (Gaussians.cat(near, far), Gaussians.cat(far, near)):
        image, alpha, depth = draw(splats)
        np.testing.assert_allclose(image[..., 0], a, atol=1e-12)
        np.testing.assert_allclose(image[..., 2], (1 - a) * b, atol=1e-12)
        total = a + (1 - a) * b
        np.testing.assert_allclose(alpha, total, atol=1e-12)
        np.testing.assert_allclose(depth[total > 0], ((2 * a + 3 * (1 - a) * b)[total > 0] / total[total > 0]))


def test_equal_depth_keeps_the_given_order() -> None:
    red, blue = ball(2.0, 0.5, 0.9, (1, 0, 0)), ball(2.0, 0.5, 0.9, (0, 0, 1))
    image, _, _ = draw(Gaussians.cat(red, blue))
    assert image[7, 10, 0] == pytest.approx(0.9, abs=1e-3)
    assert image[7, 10, 2] == pytest.approx(0.09, abs=1e-3)


def test_alpha_is_clamped_and_a_finished_pixel_does_not_change() -> None:
    opaque = [ball(2.0 + 0.1 * i, 5.0, 1.0, (1, 1, 1)) for i in range(4)]
    _, alpha, _ = draw(opaque[0])
    assert alpha[7, 10] == pytest.approx(0.99)
    # 0.01^2 is not above 1e-4, so the pixel stops before the second splat.
    _, alpha, _ = draw(Gaussians.cat(*opaque))
    assert alpha[7, 10] == pytest.approx(0.99)


def test_covariance_is_that_of_projected_samples() -> None:
    """The 2D covariance of a small splat equals that of samples projected with Camera.project."""
    camera = make_camera(640, 480, focal=700.0)
    splats = make_splats(3, log_scale=-5.5, spread=0.2)
    means2d, cov2d, det, depths, _ = project(splats, camera)
    rng = np.random.default_rng(0)
    for i in range(3):
        # wxyz quaternion to matrix: rotate each axis, q v q*
        w, *v = (splats.quats[i] / splats.quats[i].norm()).tolist()
        v = np.array(v)
        axes = np.stack([e + 2 * np.cross(v, np.cross(v, e) + w * e) for e in np.eye(3)], axis=1)
        local = rng.standard_normal((200_000, 3)) * splats.scales[i].numpy()
        pixels, depth = camera.project(local @ axes.T + splats.means[i].numpy())
        np.testing.assert_allclose(pixels.mean(0), means2d[i], atol=0.05)
        np.testing.assert_allclose(depth.mean(), depths[i], rtol=1e-3)
        sampled, found = np.cov(pixels.T), cov2d[i].numpy() - np.array([0.3, 0.0, 0.3])
        np.testing.assert_allclose(
            [sampled[0, 0], sampled[0, 1], sampled[1, 1]], found, atol=0.02 * np.abs(sampled).max()
        )
        assert det[i].item() == pytest.approx((cov2d[i, 0] * cov2d[i, 2] - cov2d[i, 1] ** 2).item())


@pytest.mark.parametrize(("focal", "bound"), [(700.0, 2.0), (100.0, 3.2 + 0.3 * 3.2)])
def test_the_projection_is_linearized_within_a_field(focal: float, bound: float) -> None:
    """A ball far beside the camera: within 2 times the depth, or 0.3 half pictures beyond the edge of a wide view."""
    K = np.array([[focal, 0, 320.0], [0, focal, 240.0], [0, 0, 1]])
    camera = Camera("a", 640, 480, K, np.eye(4))
    size, depth = 0.1, 2.0
    ball = Gaussians(
        torch.tensor([[9 * depth, 0.0, depth], [-9 * depth, 0.0, depth]]),
        torch.tensor([[1.0, 0, 0, 0]]).repeat(2, 1),
        torch.full((2, 3), math.log(size)),
        torch.zeros(2),
        torch.zeros(2, 1, 3),
    )
    _, cov2d, _, _, _ = project(ball, camera)
    scale = (focal * size / depth) ** 2
    expected = [scale * (1 + bound**2) + 0.3, 0.0, scale + 0.3]
    np.testing.assert_allclose(cov2d, [expected, expected], rtol=1e-4, atol=1e-3)


def test_spherical_harmonics_are_orthonormal() -> None:
    """Integrals of products over the sphere: Gauss-Legendre in z, equal steps in azimuth."""
    nodes, weights = np.polynomial.legendre.leggauss(12)
    angle = np.arange(24) * 2 * np.pi / 24
    z = np.repeat(nodes, 24)
    ring = np.sqrt(1 - z * z)
    directions = torch.tensor(np.stack([ring * np.cos(np.tile(angle, 12)), ring * np.sin(np.tile(angle, 12)), z], 1))
    area = torch.tensor(np.repeat(weights, 24) * 2 * np.pi / 24)
    basis = sh_basis(directions, 3)
    torch.testing.assert_close(
        basis.T @ (basis * area[:, None]), torch.eye(16, dtype=torch.float64), atol=1e-12, rtol=0
    )


def test_spherical_harmonics_match_the_order_and_signs_of_3dgs() -> None:
    x, y, z = torch.eye(3, dtype=torch.float64)
    first = sh_basis(torch.stack([x, y, z]), 1)[:, 1:]
    c = 0.4886025119029199
    torch.testing.assert_close(first, torch.tensor([[0, 0, -c], [-c, 0, 0], [0, c, 0]], dtype=torch.float64))
    # m = -2 .. 2 are xy, yz, 3 z^2 - 1, xz, x^2 - y^2; each is the largest along its own axis
    s = math.sqrt(0.5)
    axes = torch.tensor([[s, s, 0], [0, s, s], [0, 0, 1], [s, 0, s], [1, 0, 0]], dtype=torch.float64)
    second = sh_basis(axes, 2)[:, 4:]
    assert second.abs().argmax(0).tolist() == [0, 1, 2, 3, 4]
    assert second.diagonal().sign().tolist() == [1, -1, 1, -1, 1]


def test_gradcheck() -> None:
    camera = make_camera(4, 3, focal=4.0)
    splats = make_splats(3, degree=1, log_scale=-1.5, opacity=1.0, dilation=0.05)
    leaves = [tensor.requires_grad_() for _, tensor in splats.items()]
    offsets = torch.zeros(3, 2, dtype=torch.float64, requires_grad=True)
    background = torch.tensor([0.3, 0.6, 0.1], dtype=torch.float64, requires_grad=True)

    def function(*values: torch.Tensor) -> tuple[torch.Tensor, ...]:
        *attributes, shift, behind = values
        render = rasterize(Gaussians(*attributes, 0.05), camera, behind, backend="reference", screen_offsets=shift)
        return render.image, render.alpha, render.depth

    assert torch.autograd.gradcheck(function, (*leaves, offsets, background))
