"""Local rotations against scipy's."""

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from studio.training.splat_rotation import local_rotations, neighbors


def wxyz(rotation: Rotation) -> torch.Tensor:
    return torch.from_numpy(rotation.as_quat(canonical=True)[:, [3, 0, 1, 2]])


@pytest.mark.parametrize("flat", [False, True])
def test_splats_rotate_with_a_rigid_body(flat: bool) -> None:
    points = np.random.default_rng(0).normal(size=(200, 3))
    if flat:
        points[:, 2] = 0
    turn = Rotation.from_rotvec([[0.4, -0.2, 0.7]])
    before, after = torch.from_numpy(points), torch.from_numpy(turn.apply(points) + np.array([1.0, 2.0, 3.0]))
    near = neighbors(before, 12)
    assert near.shape == (200, 12)
    assert not bool((near == torch.arange(200)[:, None]).any()), "no splat is its own neighbor"
    found = local_rotations(before, after, near)
    assert torch.allclose((found * wxyz(turn)).sum(-1).abs(), torch.ones(200).double(), atol=1e-9)


def test_a_splat_without_neighbors_does_not_rotate() -> None:
    before = torch.rand(2, 3)
    found = local_rotations(before, torch.rand(2, 3), neighbors(before, 8))
    assert torch.equal(found, torch.tensor([[1.0, 0, 0, 0], [1.0, 0, 0, 0]]))
