"""Quaternions against SciPy."""

import numpy as np
from scipy.spatial.transform import Rotation

from studio.rotations import quat_multiply
from studio.stream.profiles.motion import CUBE_AXES, CUBE_QUATS, nearest_form


def scipy(quats):
    return Rotation.from_quat(quats[..., [1, 2, 3, 0]])


def some(count, seed=0):
    quats = np.random.default_rng(seed).normal(size=(count, 4))
    return quats / np.linalg.norm(quats, axis=1, keepdims=True)


def test_the_cube_has_24_rotations():
    group = Rotation.create_group("O")
    assert len(CUBE_QUATS) == 24
    for quat, axes in zip(CUBE_QUATS, CUBE_AXES, strict=True):
        assert min((group * scipy(quat).inv()).magnitude()) < 1e-6
        turned = scipy(quat).as_matrix()  # column j: where axis j goes
        assert np.array_equal(np.abs(turned).argmax(axis=0), axes)


def test_nearest_form_is_the_same_gaussian_and_nearest():
    quats = some(300)
    scales = np.random.default_rng(2).uniform(0.1, 2, (300, 3))
    factors, axes = nearest_form(quats)
    new, new_scales = quat_multiply(quats, factors), np.take_along_axis(scales, axes, axis=1)

    def covariance(q, s):
        halves = scipy(q).as_matrix() * s[:, None]
        return halves @ halves.transpose(0, 2, 1)

    assert np.allclose(covariance(new, new_scales), covariance(quats, scales))
    angles = scipy(new).magnitude()
    best = np.min([(scipy(quats) * c).magnitude() for c in Rotation.create_group("O")], axis=0)
    assert np.allclose(angles, best, atol=1e-6)
    assert angles.max() < np.radians(62.9)  # the farthest that a rotation can be from all 24
