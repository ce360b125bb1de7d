"""Shapes of splats against SciPy and NumPy."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from v3studio.studio.stream.shapes import ENTRIES, shape_axes, shapes_of


def some(count, seed=0):
    """Rotations, and scales of which some are equal."""
    generator = np.random.default_rng(seed)
    scales = np.exp(generator.normal(-5, 1.2, (count, 3)))
    scales[: count // 4] = scales[: count // 4, :1]
    scales[count // 4 : count // 2, 1] = scales[count // 4 : count // 2, 0]
    return Rotation.random(count, rng=generator), scales


def matrices(shapes):
    found = np.empty((shapes.shape[1], 3, 3))
    for (row, column), values in zip(ENTRIES, shapes, strict=True):
        found[:, row, column] = found[:, column, row] = values
    return found


def covariances(rotations, scales):
    axes = rotations.as_matrix() * scales[:, None]
    return axes @ axes.transpose(0, 2, 1)


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_axes_of_shapes_are_those_they_were_made_from(dtype: type[np.floating]) -> None:
    rotations, scales = some(3000)
    quats, log_scales = shape_axes(shapes_of(rotations.as_quat(scalar_first=True), scales).astype(dtype))
    assert quats.dtype == log_scales.dtype == dtype
    assert np.allclose(np.linalg.norm(quats, axis=1), 1, atol=2e-5)
    found = covariances(Rotation.from_quat(quats, scalar_first=True), np.exp(log_scales.astype(np.float64)))
    wanted = covariances(rotations, scales)
    size = np.trace(wanted, axis1=1, axis2=2)[:, None, None]
    assert (np.abs(found - wanted) / size).max() < 2e-5


def test_any_symmetric_matrix_has_axes() -> None:
    """Shapes may have negative eigenvalues, which quantization may cause: a scale is the square of one."""
    shapes = np.random.default_rng(1).normal(size=(6, 500)).astype(np.float32)
    shapes[:, 0] = 0
    shapes[:, 1] = (1, 1, 1, 0, 0, 0)
    shapes[:, 2] = (1, 1, 1, 1, 1, 1)  # one eigenvalue is 3, two are 0
    quats, log_scales = shape_axes(shapes)
    assert np.isfinite(quats).all()
    assert np.isfinite(log_scales).all()
    wanted = np.sort(np.linalg.eigvalsh(matrices(shapes)) ** 2, axis=1)
    assert np.allclose(np.sort(np.exp(log_scales), axis=1), wanted, rtol=1e-4, atol=1e-5)
