"""Blocks against known motion."""

import numpy as np
from scipy.spatial.transform import Rotation

from v3studio.studio.stream.motion_blocks import Blocks, find_blocks


def two_bodies(splats=2000, frames=5):
    generator = np.random.default_rng(0)
    start = generator.uniform(-0.5, 0.5, (splats, 3))
    second = generator.random(splats) < 0.5
    paths = []
    for t in range(frames):
        turned = start @ Rotation.from_rotvec([0, 0, 0.2 * t]).as_matrix().T + [0, 0.1 * t, 0]
        paths.append(np.where(second[:, None], turned, start))
    return np.array(paths), second


def test_bodies_that_pass_through_each_other_are_told_apart() -> None:
    paths, second = two_bodies()
    labels = find_blocks(paths, step=1e-4)
    assert set(labels) == set(range(labels.max() + 1))
    firsts = [int(np.flatnonzero(labels == label)[0]) for label in range(labels.max() + 1)]
    assert firsts == sorted(firsts)  # numbered by their first splat
    of_second, sizes = np.bincount(labels, weights=second), np.bincount(labels)
    strangers = np.minimum(of_second, sizes - of_second).sum()
    assert strangers < 0.06 * len(labels)  # blocks of neighbors would hold half of each body


def test_fit_finds_the_affine_motion_past_outliers() -> None:
    generator = np.random.default_rng(2)
    cells = generator.integers(0, 1000, (600, 3))
    labels = np.repeat([0, 1, 2], 200)
    blocks = Blocks.over(cells, labels, 3, 0.001, 0.3)
    shear = np.array([[0, 0.1, 0], [0, 0, 0], [0, 0, -0.2]])
    wanted = (cells * 0.001) @ shear + np.array([0.3, 0.0, -0.1]) * (labels[:, None] + 1)
    moved = wanted.copy()
    moved[::10] += 2.0  # a tenth moves otherwise
    displaced = blocks.displace(blocks.fit(moved))
    clean = np.ones(600, bool)
    clean[::10] = False
    assert np.abs(displaced - wanted)[clean].max() < 0.005
    plain = np.linalg.lstsq(blocks.local[:200], moved[:200], rcond=None)[0]
    assert np.abs(blocks.local[:200] @ plain - wanted[:200]).max() > 0.1  # least squares alone is bent
