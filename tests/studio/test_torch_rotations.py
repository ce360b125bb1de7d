"""Torch rotations against SciPy's."""

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from v3studio.studio.torch_rotations import align_axes, quat_multiply, quats_to_matrices, rotate_vectors


def wxyz(rotation: Rotation) -> torch.Tensor:
    return torch.from_numpy(rotation.as_quat(canonical=True)[:, [3, 0, 1, 2]])


def test_quats_to_matrices_of_any_length() -> None:
    turns = Rotation.random(20, random_state=3)
    found = quats_to_matrices(2.5 * wxyz(turns))
    np.testing.assert_allclose(found.numpy(), turns.as_matrix(), atol=1e-12)


def test_products() -> None:
    one, two = Rotation.random(20, random_state=1), Rotation.random(20, random_state=2)
    product = quat_multiply(wxyz(one), wxyz(two))
    assert (product * wxyz(one * two)).sum(-1).abs().numpy() == pytest.approx(1)
    first = quat_multiply(wxyz(one)[:1], wxyz(two))
    assert (first * wxyz(one[:1] * two)).sum(-1).abs().numpy() == pytest.approx(1)


def test_rotated_vectors() -> None:
    turns, vectors = Rotation.random(20, random_state=4), np.random.default_rng(0).normal(size=(20, 3))
    found = rotate_vectors(wxyz(turns), torch.from_numpy(vectors))
    np.testing.assert_allclose(found.numpy(), turns.apply(vectors), atol=1e-12)


def test_axes_with_other_names_get_those_of_the_reference() -> None:
    """Each of the 24 rotations of a cube renames the axes of an ellipsoid without changing it."""
    cube = Rotation.create_group("O")
    turns = Rotation.random(24, random_state=4)
    scales = torch.tensor([[1.0, 2.0, 3.0]]).double().repeat(24, 1)
    renamed = turns * cube
    order = np.abs(cube.as_matrix()).argmax(axis=1)
    quats, found = align_axes(wxyz(renamed), scales.gather(1, torch.from_numpy(order)), -wxyz(turns))
    torch.testing.assert_close(quats, -wxyz(turns))
    torch.testing.assert_close(found, scales)
    near = turns * Rotation.from_rotvec(0.3 * np.random.default_rng(0).standard_normal((24, 3)) / 2)
    quats, found = align_axes(wxyz(renamed), scales, wxyz(near))
    axes, same = quats_to_matrices(quats), quats_to_matrices(wxyz(renamed))
    torch.testing.assert_close(axes @ torch.diag_embed(found) @ axes.mT, same @ torch.diag_embed(scales) @ same.mT)
    assert ((quats * wxyz(near)).sum(-1) > np.cos(0.5)).all()
