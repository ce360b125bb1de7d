"""Scenes, and the comparison of a backend with the reference implementation."""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from v3studio.studio.cameras import Camera
from v3studio.studio.gaussians import Gaussians
from v3studio.studio.rasterizer import rasterize, set_kernel_threads
from v3studio.studio.rasterizer.reference import project, visible_radii
from v3studio.studio.rasterizer.types import ALPHA_MAX, ALPHA_MIN, TRANSMITTANCE_MIN


def make_camera(
    width: int = 75,
    height: int = 49,
    *,
    focal: float = 60.0,
    principal: tuple[float, float] | None = None,
    turn: float = 0.3,
    distance: float = 3.0,
) -> Camera:
    """A camera at `distance` from the origin, rotated by `turn` radians about the y axis."""
    cx, cy = principal if principal is not None else (0.44 * width, 0.51 * height)
    pose = np.eye(4)
    pose[:3, :3] = [[math.cos(turn), 0, math.sin(turn)], [0, 1, 0], [-math.sin(turn), 0, math.cos(turn)]]
    pose[2, 3] = distance
    return Camera("test", width, height, np.array([[focal, 0, cx], [0, 1.03 * focal, cy], [0, 0, 1]]), pose)


def make_splats(
    count: int,
    *,
    degree: int = 3,
    seed: int = 0,
    log_scale: float = -3.0,
    spread: float = 0.5,
    opacity: float = 2.0,
    dilation: float = 0.3,
) -> Gaussians:
    """Random float64 splats around the origin whose values are exactly representable in float32."""
    generator = torch.Generator().manual_seed(seed)

    def normal(*shape: int) -> Tensor:
        return torch.randn(*shape, generator=generator).double()

    return Gaussians(
        means=normal(count, 3) * spread,
        quats=normal(count, 4),
        log_scales=normal(count, 3) * 0.5 + log_scale,
        logit_opacities=normal(count) * opacity,
        sh=normal(count, (degree + 1) ** 2, 3) * 0.3,
        dilation=dilation,
    ).map(lambda tensor: tensor.float().double())


def sturdy_pixels(splats: Gaussians, camera: Camera) -> Tensor:
    """(H, W) True where no threshold of the definition is within float32 rounding.

    The image is discontinuous where the alpha of a splat crosses 1/255, where transmittance crosses 1e-4, and where two
    splats of equal depth swap; the gradient also where alpha crosses `ALPHA_MAX`. A float32 backend may take the other
    branch there.
    """
    splats = splats.detach().to(torch.float64)
    half, depths = visible_radii(splats, camera, None)
    index = torch.nonzero(half[:, 0] > 0)[:, 0]
    index = index[torch.argsort(depths[index], stable=True)]
    means2d, cov2d, det, depths, _ = project(splats[index], camera)
    ys, xs = torch.meshgrid(torch.arange(camera.height) + 0.5, torch.arange(camera.width) + 0.5, indexing="ij")
    dx, dy = xs.reshape(-1, 1) - means2d[:, 0], ys.reshape(-1, 1) - means2d[:, 1]
    sigma = (cov2d[:, 2] * dx * dx - 2 * cov2d[:, 1] * dx * dy + cov2d[:, 0] * dy * dy) / (2 * det)
    alpha = splats.opacities[index] * torch.exp(-sigma)
    drawn = torch.where(alpha >= ALPHA_MIN, alpha.clamp_max(ALPHA_MAX), 0.0)
    transmittance = torch.cumprod(1 - drawn, dim=1)
    matters = torch.cat([torch.ones_like(transmittance[:, :1]), transmittance[:, :-1]], 1) > 0.99 * TRANSMITTANCE_MIN
    at_threshold = ((alpha / ALPHA_MIN - 1).abs() < 1e-4) | ((alpha / ALPHA_MAX - 1).abs() < 1e-4)
    sturdy = ~(at_threshold & matters).any(1)
    sturdy &= ((transmittance / TRANSMITTANCE_MIN - 1).abs() > 1e-3).all(1)
    close = (depths[1:] - depths[:-1]).abs() < 2e-6 * depths[1:]
    tied = torch.zeros_like(drawn, dtype=torch.bool)
    tied[:, 1:] |= close
    tied[:, :-1] |= close
    sturdy &= (tied & (drawn > 0) & matters).sum(1) < 2
    return sturdy.reshape(camera.height, camera.width)


@dataclass
class Drawn:
    """Outputs and gradients of one backend."""

    image: Tensor
    alpha: Tensor
    depth: Tensor
    radii: Tensor
    gradients: dict[str, Tensor]


def draw(
    splats: Gaussians,
    camera: Camera,
    backend: str,
    dtype: torch.dtype = torch.float64,
    *,
    weight: Tensor | None = None,
    outputs: tuple[str, ...] = ("image", "alpha", "depth"),
    device: str = "cpu",
    picture: bool = False,
) -> Drawn:
    """Render and backpropagate a random linear loss; `weight` (H, W) scales the loss of each pixel. With `picture`, the
    background differs from pixel to pixel."""
    leaves = splats.map(lambda tensor: tensor.detach().to(device, dtype, copy=True).requires_grad_())
    offsets = torch.zeros(len(splats), 2, dtype=dtype, device=device, requires_grad=True)
    background = torch.tensor([0.2, 0.5, 1.0], dtype=dtype, device=device)
    if picture:
        rows = torch.linspace(0.1, 1.0, camera.height, dtype=dtype, device=device)
        background = rows[:, None, None] * background.repeat(camera.width, 1)
    background.requires_grad_()
    render = rasterize(leaves, camera, background, backend=backend, screen_offsets=offsets)
    generator = torch.Generator().manual_seed(1)
    loss = render.image.sum() * 0
    for name in ("image", "alpha", "depth"):
        value = getattr(render, name)
        factor = (torch.rand(value.shape, generator=generator, dtype=torch.float64) - 0.5).to(device, dtype)
        if weight is not None:
            factor = factor * weight.reshape(weight.shape + (1,) * (value.ndim - 2)).to(factor)
        if name in outputs:
            loss = loss + (value * factor).sum()
    loss.backward()
    gradients = {name: tensor.grad for name, tensor in leaves.items()}
    gradients |= {"screen_offsets": offsets.grad, "background": background.grad}
    return Drawn(
        *(getattr(render, name).detach().cpu().double() for name in ("image", "alpha", "depth", "radii")),
        {name: torch.zeros(()) if grad is None else grad.cpu().double() for name, grad in gradients.items()},
    )


def assert_same(
    ours: Drawn, truth: Drawn, *, where: Tensor | None = None, image: float = 1e-4, gradient: float = 1e-3
) -> None:
    """Assert that images agree within `image`, and gradients within `gradient` relative to their norm."""
    where = torch.ones_like(truth.alpha, dtype=torch.bool) if where is None else where
    for name in ("image", "alpha"):
        error = (getattr(ours, name) - getattr(truth, name)).abs()[where]
        assert not len(error) or error.max() <= image, f"{name} is off by {error.max():.2e}"
    depth = (ours.depth - truth.depth).abs()[where] / truth.depth[where].clamp_min(1e-3)
    assert not len(depth) or depth.max() <= image, f"depth is off by {depth.max():.2e}"
    largest = max((float(true.norm()) for true in truth.gradients.values()), default=0.0)
    for name, true in truth.gradients.items():
        mine = ours.gradients[name]
        assert torch.isfinite(mine).all(), f"the gradient of {name} is not finite"
        size, error = true.norm(), (mine - true).norm()
        # The absolute term covers rounding where everything cancels, as in the turn of a splat that is almost round.
        assert error <= gradient * size + 1e-6 * max(1.0, largest), (
            f"the gradient of {name} is off by {error / size:.2e} of {size:.2e}"
        )


def assert_same_by_any_threads(results: Callable[[], Iterable[Tensor]]) -> None:
    """All results have the same bits, whether the kernels use one, two or three threads."""
    found = []
    try:
        for threads in (1, 2, 3):
            set_kernel_threads(threads)
            found.append(tuple(results()))
    finally:
        set_kernel_threads(None)
    assert all(torch.equal(first, other) for run in found[1:] for first, other in zip(found[0], run, strict=True))
