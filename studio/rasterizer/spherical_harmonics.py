"""Real spherical harmonics up to degree 3, with the order and signs of 3DGS.

Source: Sloan, "Efficient Spherical Harmonic Evaluation", JCGT 2013. Within degree l, m goes from -l to l, with the
Condon-Shortley phase, as in Plenoxels, 3DGS and gsplat.
"""

import torch
from torch import Tensor


def sh_basis(directions: Tensor, degree: int) -> Tensor:
    """The SH basis, (N, (degree + 1)^2), at unit directions (N, 3) from the camera to the splat, in the world."""
    x, y, z = directions.unbind(-1)
    basis = [torch.full_like(x, 0.28209479177387814)]
    if degree >= 1:
        basis += [-0.4886025119029199 * y, 0.4886025119029199 * z, -0.4886025119029199 * x]
    if degree >= 2:
        basis += [
            1.0925484305920792 * x * y,
            -1.0925484305920792 * y * z,
            0.31539156525252005 * (3 * z * z - 1),
            -1.0925484305920792 * x * z,
            0.5462742152960396 * (x * x - y * y),
        ]
    if degree >= 3:
        basis += [
            -0.5900435899266435 * y * (3 * x * x - y * y),
            2.890611442640554 * x * y * z,
            -0.4570457994644658 * y * (5 * z * z - 1),
            0.3731763325901154 * z * (5 * z * z - 3),
            -0.4570457994644658 * x * (5 * z * z - 1),
            1.445305721320277 * z * (x * x - y * y),
            -0.5900435899266435 * x * (x * x - 3 * y * y),
        ]
    return torch.stack(basis, dim=-1)


def sh_colors(directions: Tensor, sh: Tensor) -> Tensor:
    """RGB at least 0 along unit directions: max(0, 0.5 + sum_k Y_k sh_k), of sh (N, K, 3), K = 1, 4, 9 or 16."""
    degree = {1: 0, 4: 1, 9: 2, 16: 3}[sh.shape[1]]
    basis = sh_basis(directions, degree)
    return (torch.einsum("nk,nkc->nc", basis, sh) + 0.5).clamp_min(0.0)
