"""The fall of brightness toward the corners of a camera's image: an even polynomial, fitted to what splats draw.

The gain at distance r from the principal point is 1 + a r^2 + b r^4, with r = 1 at half the diagonal of the image
(the even polynomial of Adobe's lens profiles and of Goldman, "Vignette and Exposure Calibration and Compensation",
PAMI 2010, cut after the second term). Further out than any pixel that it was fitted to, the gain stays what it is
there: a polynomial says nothing about what lies outside.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from studio.cameras import Camera
from studio.color_fit import fit_color, neutral

RIDGE = 1e-4
"""Weight of the squared changes in gain that the two terms make at the reach, against the mean squared error of colors
in 0 to 1."""

_ROUNDS = 5


@dataclass(frozen=True)
class Vignette:
    """Gain of a camera over its image.

    Attributes:
        a, b: factors of r^2 and r^4.
        reach: greatest r^2 that it was fitted to.
    """

    a: float
    b: float
    reach: float

    def gain(self, camera: Camera, full_size: tuple[int, int], device: torch.device | str = "cpu") -> Tensor:
        """(H, W) float32 factors of a camera's image.

        Args:
            camera: pinhole camera of the image, which may be cropped or resized.
            full_size: (width, height) of the image before it was cropped, at its present scale.
            device: of the result.
        """
        return self.gain_at(radius_squared(camera, full_size, device))

    def gain_at(self, r2: Tensor) -> Tensor:
        """Factors, float32, where `radius_squared` is `r2`; any shape."""
        r2 = r2.clamp_max(self.reach)
        return (1 + self.a * r2 + self.b * r2 * r2).float()


def radius_squared(camera: Camera, full_size: tuple[int, int], device: torch.device | str = "cpu") -> Tensor:
    """(H, W) float64 squared distance of the pixels from the principal point; 1 at half the diagonal of the full image.

    Args:
        camera, full_size, device: see `Vignette.gain`.
    """
    rows = torch.arange(camera.height, dtype=torch.float64, device=device) + 0.5 - camera.cy
    columns = torch.arange(camera.width, dtype=torch.float64, device=device) + 0.5 - camera.cx
    return (rows[:, None] ** 2 + columns[None] ** 2) * (4 / (full_size[0] ** 2 + full_size[1] ** 2))


def fit_color_and_vignette(
    premultiplied: Tensor, alpha: Tensor, target: Tensor, r2: Tensor, weights: Tensor, ridge: float
) -> tuple[Tensor, Vignette]:
    """The matrix M and the gain g that minimize the weighted mean of |g M [p, alpha] - target|^2, plus the squared
    differences of M from neutral (`ridge`) and of g from 1 (`RIDGE`).

    Gauss-Newton: their product is linear in either, but not in both, and fitting them in turn takes dozens of rounds,
    because a darker matrix and a darker rim look alike. Lenses do not brighten toward the corners: where two terms
    would, at the center or at the reach, one term is fitted, and where that would, there is no vignette.

    Args:
        premultiplied, alpha, target: (H, W, 3), (H, W) and (H, W, 3), see `studio.color_fit.fit_color`.
        r2: (H, W), see `radius_squared`.
        weights: (H, W) of the pixels, at least 0.
        ridge: of the matrix, at least 0.

    Returns:
        (3, 4) float64 matrix on the device of the pixels, and the vignette, whose gain falls or is 1.
    """
    used = weights.reshape(-1) > 0
    plain = fit_color(premultiplied, alpha, target, weights, ridge)
    if not bool(used.any()):
        return plain, Vignette(0.0, 0.0, 0.0)
    w = weights.reshape(-1)[used].double()
    base = torch.cat([premultiplied.reshape(-1, 3), alpha.reshape(-1, 1)], 1)[used].double()
    y, distance = target.reshape(-1, 3)[used].double(), r2.reshape(-1)[used]
    reach = max(float(distance.max()), 1e-12)
    for count in (2, 1):
        powers = torch.stack([(distance / reach) ** (1 + power) for power in range(count)], 1)
        matrix, factors = _gauss_newton(plain, base, y, powers, w / w.sum(), ridge)
        a, b = (*factors, 0.0)[:2]
        if a <= 0 and a + 2 * b <= 0:  # the slope at the center and at the reach
            return matrix, Vignette(a / reach, b / reach**2, reach)
    return plain, Vignette(0.0, 0.0, reach)


def _gauss_newton(
    matrix: Tensor, base: Tensor, y: Tensor, powers: Tensor, w: Tensor, ridge: float
) -> tuple[Tensor, list[float]]:
    """The matrix, from a first one, and the factors of `powers` (P, T) in the gain; `base` (P, 4), `y` (P, 3), `w` (P)
    of sum 1."""
    count = powers.shape[1]
    terms = base.new_zeros(count)
    penalty = torch.tensor([ridge] * 12 + [RIDGE] * count, dtype=base.dtype, device=base.device)
    for _ in range(_ROUNDS):
        gain = 1 + powers @ terms
        colors = base @ matrix.T
        left = y - gain[:, None] * colors
        scaled = base * gain[:, None]
        # derivatives of a channel: by its row of the matrix `scaled`, by the terms `powers` times its color
        normal = torch.block_diag(*[scaled.T @ (scaled * w[:, None])] * 3, base.new_zeros(count, count))
        mixed = torch.cat([scaled.T @ (powers * (w * colors[:, channel])[:, None]) for channel in range(3)])
        normal[:12, 12:], normal[12:, :12] = mixed, mixed.T
        normal[12:, 12:] = powers.T @ (powers * (w * colors.square().sum(1))[:, None])
        slope = torch.cat([(scaled.T @ (left * w[:, None])).T.reshape(-1), powers.T @ (w * (left * colors).sum(1))])
        change = torch.cat([(matrix - neutral(matrix)).reshape(-1), terms])
        step = torch.linalg.pinv(normal + penalty.diag(), rtol=1e-9, hermitian=True) @ (slope - penalty * change)
        matrix, terms = matrix + step[:12].reshape(3, 4), terms + step[12:]
    return matrix, terms.tolist()
