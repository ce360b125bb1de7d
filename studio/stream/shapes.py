"""Shape of a splat as one symmetric matrix, which the stream stores.

A splat with rotation R and scales s has the matrix M = R diag(sqrt(s)) R^T, and its covariance is M^4. Unlike rotation
and scales, M does not depend on how the axes are named, is similar for neighbors on a surface, and changes little where
an almost round splat turns, which no image shows.
"""

import numpy as np

from v3studio.studio.rotations import quat_multiply, quats_to_matrices

ENTRIES = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
"""Rows and columns of the six numbers of M, in the order of the channels."""

_PAIRS = ((0, 1, 3, -1.0), (0, 2, 2, 1.0), (1, 2, 1, -1.0))  # two axes, what turns around: component and sign
_SWEEPS = 3  # leaves 1e-5 of the covariance
_SMALLEST = 1e-12  # scale: its logarithm is finite


def shapes_of(quats: np.ndarray, scales: np.ndarray) -> np.ndarray:
    """The six numbers of M, (6, N) float64, of unit quaternions (N, 4) and scales (N, 3) above 0."""
    axes = quats_to_matrices(quats) * np.sqrt(np.sqrt(scales, dtype=np.float64))[:, None, :]
    # no matrix product: its rounding depends on the processor, and so would the stream's bytes
    return np.stack([(axes[:, row] * axes[:, column]).sum(axis=1) for row, column in ENTRIES])


def shape_axes(shapes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit quaternions (N, 4) and log scales (N, 3) of (6, N) symmetric matrices, by a fixed number of Jacobi rotations
    (Golub and Van Loan, section 8.5). The kernel `dequantize` has the same operations in the same order, so that
    quaternions have the same bits."""
    matrix: list[list[np.ndarray]] = [[shapes[0]] * 3 for _ in range(3)]
    for (row, column), values in zip(ENTRIES, shapes, strict=True):
        matrix[row][column] = matrix[column][row] = values
    quats = np.zeros((shapes.shape[1], 4), dtype=shapes.dtype)
    quats[:, 0] = 1
    unit, two = shapes.dtype.type(1), shapes.dtype.type(2)
    for p, q, around, sign in _PAIRS * _SWEEPS:
        other, across = 3 - p - q, matrix[p][q]
        difference = matrix[q][q] - matrix[p][p]
        reach = np.abs(difference) + np.sqrt(difference * difference + (two * across) * (two * across))
        tangent = two * across / np.maximum(reach, np.finfo(np.float32).tiny)
        tangent = np.where(difference < 0, -tangent, tangent)
        cosine = unit / np.sqrt(unit + tangent * tangent)
        sine = tangent * cosine
        matrix[p][p] = matrix[p][p] - tangent * across
        matrix[q][q] = matrix[q][q] + tangent * across
        matrix[p][q] = matrix[q][p] = np.zeros_like(across)
        first, second = matrix[other][p], matrix[other][q]
        matrix[other][p] = matrix[p][other] = cosine * first - sine * second
        matrix[other][q] = matrix[q][other] = sine * first + cosine * second
        half = np.sqrt((unit + cosine) / two)
        turn = np.zeros_like(quats)
        turn[:, 0] = half
        turn[:, around] = shapes.dtype.type(sign) * sine / (two * half)
        quats = quat_multiply(quats, turn)
    roots = np.stack([matrix[k][k] for k in range(3)], axis=1)
    return quats, np.log(np.maximum(roots * roots, shapes.dtype.type(_SMALLEST)))
