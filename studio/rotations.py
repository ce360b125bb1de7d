"""Rotations in NumPy: quaternions wxyz, matrices, modified Rodrigues parameters.

Quaternions are (w, x, y, z) with the scalar first, in arrays whose last axis has length 4; SciPy's order is
(x, y, z, w). Conversions use `scipy.spatial.transform.Rotation` in float64. Products, conjugates and Rodrigues
parameters keep the dtype of their input and use a fixed order of operations, because the stream's bytes depend on them.
The torch counterparts are in `studio.torch_rotations`.
"""

import numpy as np


def quats_to_matrices(quats: np.ndarray) -> np.ndarray:
    """Rotation matrices (..., 3, 3) float64 of quaternions (..., 4) wxyz of any norm; ValueError: 0 or not finite."""
    from scipy.spatial.transform import Rotation

    quats = np.asarray(quats, np.float64)
    if not np.isfinite(quats).all():
        raise ValueError("a quaternion is not finite")
    flat = quats.reshape(-1, 4)[:, [1, 2, 3, 0]]
    matrices: np.ndarray = Rotation.from_quat(flat).as_matrix().reshape(*quats.shape[:-1], 3, 3)
    return matrices


def matrices_to_quats(matrices: np.ndarray) -> np.ndarray:
    """Unit quaternions (..., 4) wxyz float64 with w >= 0 of rotation matrices (..., 3, 3).

    For a matrix that is not exactly orthonormal, the nearest rotation is used.
    """
    from scipy.spatial.transform import Rotation

    matrices = np.asarray(matrices, np.float64)
    xyzw = Rotation.from_matrix(matrices.reshape(-1, 3, 3)).as_quat(canonical=True)
    quats: np.ndarray = xyzw[:, [3, 0, 1, 2]].reshape(*matrices.shape[:-2], 4)
    return quats


def quat_multiply(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Hamilton product (..., 4): the rotation `right` followed by `left`. Shapes broadcast; the dtype is kept."""
    aw, ax, ay, az = (left[..., i] for i in range(4))
    bw, bx, by, bz = (right[..., i] for i in range(4))
    return np.stack(
        [
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ],
        axis=-1,
    )


def quat_conjugate(quats: np.ndarray) -> np.ndarray:
    """Conjugates (..., 4), which are the inverses of unit quaternions. The dtype is kept."""
    return quats * np.array([1, -1, -1, -1], dtype=quats.dtype)


def quats_to_mrp(quats: np.ndarray) -> np.ndarray:
    """Modified Rodrigues parameters (..., 3) = (x, y, z) / (1 + w) of unit quaternions (Schaub and Junkins 1996).

    |p| = tan(angle / 4), which is at most 1 for w >= 0. Singular at w = -1. The dtype is kept.
    """
    result: np.ndarray = quats[..., 1:] / (1 + quats[..., :1])
    return result


def mrp_to_quats(mrp: np.ndarray) -> np.ndarray:
    """Unit quaternions (..., 4), the inverse of `quats_to_mrp`.

    w = (1 - |p|^2) / (1 + |p|^2), (x, y, z) = 2 p / (1 + |p|^2). The dtype is kept.
    """
    square = (mrp * mrp).sum(axis=-1, keepdims=True)
    return np.concatenate([1 - square, 2 * mrp], axis=-1) / (1 + square)
