"""NumPy rotations against SciPy's and against rotations known by hand."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from v3studio.studio.rotations import (
    matrices_to_quats,
    mrp_to_quats,
    quat_conjugate,
    quat_multiply,
    quats_to_matrices,
    quats_to_mrp,
)


def scipy(quats: np.ndarray) -> Rotation:
    return Rotation.from_quat(quats[..., [1, 2, 3, 0]])


def unit_quats(count: int, seed: int = 0) -> np.ndarray:
    quats = np.random.default_rng(seed).normal(size=(count, 4))
    return quats / np.linalg.norm(quats, axis=1, keepdims=True)


def test_a_quarter_turn_about_z_scalar_first() -> None:
    quat = np.array([np.sqrt(0.5), 0, 0, np.sqrt(0.5)])
    matrix = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    np.testing.assert_allclose(quats_to_matrices(3 * quat), matrix, atol=1e-15)
    np.testing.assert_allclose(matrices_to_quats(matrix), quat, atol=1e-15)


@pytest.mark.parametrize("bad", [[0.0, 0, 0, 0], [np.nan, 0, 0, 1]])
def test_no_rotation_is_made_up(bad: list[float]) -> None:
    with pytest.raises(ValueError, match=r"(?i)finite|norm"):
        quats_to_matrices(np.array(bad))


def test_product_and_inverse() -> None:
    a, b = unit_quats(50), unit_quats(50, 1)
    assert np.allclose((scipy(quat_multiply(a, b)).inv() * scipy(a) * scipy(b)).magnitude(), 0, atol=1e-7)
    assert np.allclose(quat_multiply(a, quat_conjugate(a)), [1, 0, 0, 0])
    assert quat_multiply(a.astype(np.float32), b.astype(np.float32)).dtype == np.float32


def test_mrp_is_scipys() -> None:
    quats = unit_quats(50)
    quats *= np.where(quats[:, :1] < 0, -1, 1)
    assert np.allclose(quats_to_mrp(quats), scipy(quats).as_mrp())
    assert np.allclose(mrp_to_quats(quats_to_mrp(quats)), quats)
