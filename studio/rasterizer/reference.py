"""The definition of the rasterizer in plain PyTorch: any floating dtype, any device, gradients by autograd.

The other backends are tested against this one. It follows 3DGS (Kerbl et al. 2023, sections 4 and 6), and gsplat where
the two differ: EWA projection with the splats' own dilation; footprints that end only where alpha falls below
1/255; front-to-back blending, in which a pixel stops before the splat that would reduce its transmittance to 1e-4.
Splats of equal depth are blended in their order in the tensors.
"""

import torch
from torch import Tensor

from v3studio.studio.cameras import Camera
from v3studio.studio.gaussians import Gaussians
from v3studio.studio.rasterizer.spherical_harmonics import sh_colors
from v3studio.studio.rasterizer.types import (
    ALPHA_MAX,
    ALPHA_MIN,
    NEAR,
    TRANSMITTANCE_MIN,
    Render,
    field_limits,
    mean_depth,
)
from v3studio.studio.torch_rotations import quats_to_matrices

TILE = 16  # Tile size in pixels. It only affects memory use


def project(gaussians: Gaussians, camera: Camera) -> tuple[Tensor, Tensor, Tensor, Tensor, Tensor]:
    """EWA projection of splats in front of the camera (Zwicker et al. 2001; 3DGS, equation 5).

    Returns:
        means2d: (N, 2) pixels.
        cov2d: (N, 3) xx, xy, yy of the dilated 2D covariance, square pixels.
        det: (N,) determinant of cov2d.
        depths: (N,) along the viewing axis, world units.
        colors: (N, 3) RGB, at least 0.
    """
    like = gaussians.means
    rotation = torch.as_tensor(camera.rotation).to(like)
    translation, center = torch.as_tensor(camera.translation).to(like), torch.as_tensor(camera.center).to(like)
    local = like @ rotation.T + translation
    x, y, depths = local.unbind(-1)
    x_z, y_z = x / depths, y / depths
    means2d = torch.stack([camera.fx * x_z + camera.cx, camera.fy * y_z + camera.cy], -1)

    left, right, top, bottom = field_limits(camera)
    x_lim, y_lim = x_z.clamp(left, right), y_z.clamp(top, bottom)
    zero = torch.zeros_like(x)
    jacobian = torch.stack(
        [
            torch.stack([camera.fx / depths, zero, -camera.fx * x_lim / depths], -1),
            torch.stack([zero, camera.fy / depths, -camera.fy * y_lim / depths], -1),
        ],
        dim=-2,
    )
    # factor: (N, 2, 3); cov2d = factor factor^T + dilation
    factor = jacobian @ rotation @ quats_to_matrices(gaussians.quats) * gaussians.scales[:, None, :]
    u, v = factor.unbind(-2)
    xx, xy, yy = (u * u).sum(-1), (u * v).sum(-1), (v * v).sum(-1)
    dilation = gaussians.dilation
    cov2d = torch.stack([xx + dilation, xy, yy + dilation], -1)
    # |u|^2 |v|^2 - (u.v)^2 = |u x v|^2 (Lagrange); the left side would cancel for needle-shaped splats.
    det = torch.linalg.cross(u, v).square().sum(-1) + dilation * (xx + yy) + dilation**2

    directions = torch.nn.functional.normalize(like - center, dim=-1)
    return means2d, cov2d, det, depths, sh_colors(directions, gaussians.sh)


@torch.no_grad()
def visible_radii(gaussians: Gaussians, camera: Camera, offsets: Tensor | None) -> tuple[Tensor, Tensor]:
    """(N, 2) half sizes in pixels of the box outside which alpha is below 1/255, 0 for splats that are not drawn; and
    (N,) depths in world units. Arguments as in `project` and `rasterize`."""
    finite = torch.isfinite(gaussians.means).all(-1) & torch.isfinite(gaussians.log_scales).all(-1)
    finite &= torch.isfinite(gaussians.quats).all(-1) & (gaussians.quats.norm(dim=-1) > 0)
    finite &= torch.isfinite(gaussians.sh).flatten(1).all(-1)
    means2d, cov2d, det, depths, colors = project(gaussians, camera)
    if offsets is not None:
        means2d = means2d + offsets
    opacities = gaussians.opacities
    reach = torch.sqrt(2 * torch.log((opacities / ALPHA_MIN).clamp_min(1.0)))
    half = reach[:, None] * torch.sqrt(cov2d[:, [0, 2]])
    shown = finite & (depths >= NEAR) & (opacities >= ALPHA_MIN) & torch.isfinite(det) & (det > 0)
    shown &= torch.isfinite(half).all(-1) & torch.isfinite(means2d).all(-1) & torch.isfinite(colors).all(-1)
    low, high = means2d - half, means2d + half
    shown &= (high > 0).all(-1) & (low[:, 0] < camera.width) & (low[:, 1] < camera.height)
    return torch.where(shown[:, None], half, torch.zeros_like(half)), depths


def blend(
    pixels: Tensor, means2d: Tensor, conics: Tensor, opacities: Tensor, features: Tensor
) -> tuple[Tensor, Tensor]:
    """Alpha-blend splats, sorted by depth, nearest first.

    Args:
        pixels: (P, 2) pixel centers.
        means2d: (S, 2) pixels.
        conics: (S, 3) xx, xy, yy of the inverse 2D covariance.
        opacities: (S,) in 0 to 1.
        features: (S, F), such as colors.

    Returns:
        (P, F) sums of weight times feature, and (P,) final transmittance.
    """
    dx, dy = (pixels[:, None] - means2d[None]).unbind(-1)
    sigma = 0.5 * (conics[:, 0] * dx * dx + conics[:, 2] * dy * dy) + conics[:, 1] * dx * dy
    alpha = (opacities * torch.exp(-sigma.clamp_min(0.0))).clamp_max(ALPHA_MAX)
    alpha = torch.where(alpha >= ALPHA_MIN, alpha, torch.zeros_like(alpha))
    transmittance = torch.cumprod(1 - alpha, dim=1)
    # Transmittance never increases, so this also drops everything behind the splat at which a pixel stops.
    alpha = torch.where(transmittance > TRANSMITTANCE_MIN, alpha, torch.zeros_like(alpha))
    before = torch.cat([torch.ones_like(transmittance[:, :1]), transmittance[:, :-1]], dim=1)
    return (alpha * before) @ features, torch.prod(1 - alpha, dim=1)


def rasterize_reference(
    gaussians: Gaussians,
    camera: Camera,
    background: Tensor | None,
    screen_offsets: Tensor | None,
) -> Render:
    """Render in plain PyTorch. Arguments as in `studio.rasterizer.rasterize`, already validated."""
    half, all_depths = visible_radii(gaussians, camera, screen_offsets)
    index = torch.nonzero(half[:, 0] > 0)[:, 0]
    index = index[torch.argsort(all_depths[index], stable=True)]
    splats, half_sides = gaussians[index], half[index]
    means2d, cov2d, det, depths, colors = project(splats, camera)
    if screen_offsets is not None:
        means2d = means2d + screen_offsets[index]
    conics = torch.stack([cov2d[:, 2], -cov2d[:, 1], cov2d[:, 0]], -1) / det[:, None]
    features = torch.cat([colors, depths[:, None]], -1)
    opacities = splats.opacities

    like = gaussians.means
    low, high = (means2d - half_sides).detach(), (means2d + half_sides).detach()
    rows = []
    for top in range(0, camera.height, TILE):
        bottom = min(top + TILE, camera.height)
        row = []
        in_row = (high[:, 1] > top) & (low[:, 1] < bottom)
        for left in range(0, camera.width, TILE):
            right = min(left + TILE, camera.width)
            inside = torch.nonzero(in_row & (high[:, 0] > left) & (low[:, 0] < right))[:, 0]
            ys = torch.arange(top, bottom, device=like.device, dtype=like.dtype) + 0.5
            xs = torch.arange(left, right, device=like.device, dtype=like.dtype) + 0.5
            pixels = torch.cartesian_prod(ys, xs).flip(-1)
            total, transmittance = blend(pixels, means2d[inside], conics[inside], opacities[inside], features[inside])
            row.append(torch.cat([total, transmittance[:, None]], -1).reshape(bottom - top, right - left, 5))
        rows.append(torch.cat(row, dim=1))
    drawn = torch.cat(rows, dim=0)

    image, transmittance = drawn[..., :3], drawn[..., 4]
    if background is not None:
        image = image + transmittance[..., None] * background
    alpha = 1 - transmittance
    return Render(image=image, alpha=alpha, depth=mean_depth(drawn[..., 3], alpha), radii=half.amax(-1))
