"""A 3x4 color matrix between two images: ridge least squares, and its application to rendered splats."""

import torch
from torch import Tensor


def neutral(like: Tensor | None = None) -> Tensor:
    """(3, 4) the matrix that changes nothing; dtype and device of `like`."""
    matrix = torch.eye(3, 4, dtype=torch.float64)
    return matrix if like is None else matrix.to(like)


def fit_color(
    premultiplied: Tensor, alpha: Tensor, target: Tensor, weights: Tensor | None = None, ridge: float = 0.0
) -> Tensor:
    """The matrix M that minimizes the weighted mean of |M [p, alpha] - target|^2, plus ridge |M - neutral|^2.

    Args:
        premultiplied: (..., 3) RGB p, rendered over black, that is, colors times alpha.
        alpha: (...) rendered alpha, 0 to 1.
        target: (..., 3) RGB of the footage, without the share of the background.
        weights: (...) of the pixels, at least 0; None: all equal.
        ridge: at least 0. 0 is plain least squares; where colors do not determine the matrix, it stays neutral.

    Returns:
        (3, 4) float64: 3x3 factors and an offset in the last column, see `correct_color`.
    """
    x, y = premultiplied.detach().reshape(-1, 3).double(), target.detach().reshape(-1, 3).double()
    base = torch.cat([x, alpha.detach().reshape(-1, 1).double()], 1)
    w = x.new_ones(len(x)) if weights is None else weights.detach().reshape(-1).double()
    total = w.sum().clamp_min(1e-12)
    normal = base.T @ (base * w[:, None]) / total + ridge * torch.eye(4, dtype=x.dtype, device=x.device)
    right = base.T @ ((y - x) * w[:, None]) / total
    # solves for the difference from neutral, so that what is not determined stays 0
    return neutral(x) + (torch.linalg.pinv(normal, rtol=1e-9, hermitian=True) @ right).T


def correct_color(premultiplied: Tensor, alpha: Tensor, matrix: Tensor) -> Tensor:
    """Drawn splats, (H, W, 3) over black, that is, colors times alpha (0 to 1), in the colors of a camera: `matrix`,
    (3, 4), is applied to the colors themselves. Differentiable."""
    matrix = matrix.to(premultiplied)
    return premultiplied @ matrix[:, :3].T + alpha[..., None] * matrix[:, 3]


def uncorrected(colors: Tensor, matrix: Tensor) -> Tensor:
    """Colors of splats that a camera sees as `colors` (..., 3), both opaque: the inverse of `correct_color`."""
    matrix = matrix.to(colors)
    return (colors - matrix[:, 3]) @ torch.linalg.pinv(matrix[:, :3]).T
