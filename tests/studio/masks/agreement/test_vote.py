"""Cameras hear from each other about a ball whose silhouettes are known exactly."""

import numpy as np
import pytest

from tests.studio.masks.scenes import ball, overlap
from tests.support.rigs import ring
from v3studio.studio.cameras import Camera, Rig
from v3studio.studio.masks.agreement.vote import SILENT, heard


def silhouette(camera: Camera) -> np.ndarray:
    return ball(camera, np.array([0.15, -0.1, 0.05]), 0.4)


def odds_of(rig: Rig) -> dict[str, np.ndarray]:
    return {camera.name: np.where(silhouette(camera), 3.0, -3.0).astype(np.float32) for camera in rig}


@pytest.mark.parametrize("distortion", [(), (-0.1, 0.02, 0.0, 0.0)])
def test_a_camera_that_misses_the_performer_hears_of_it(distortion: tuple[float, ...]) -> None:
    rig = ring(10, radius=3.0, heights=(0.0, 1.0), distortion=distortion)
    odds, missing = odds_of(rig), rig.names[3]
    odds[missing] = np.full_like(odds[missing], -3.0)
    votes = heard(odds, {camera.name: camera for camera in rig}, frozenset(rig.names))
    exact = silhouette(rig[missing])
    assert overlap(votes[missing] > 0, exact) > 0.8
    assert (votes[missing][~exact] == SILENT).mean() > 0.9


def test_held_out_cameras_hear_but_do_not_vote() -> None:
    rig = ring(10, radius=3.0, heights=(0.0, 1.0))
    cameras = {camera.name: camera for camera in rig}
    held_out, voters = rig.names[2], frozenset(rig.names) - {rig.names[2]}
    odds = odds_of(rig)
    first = heard(odds, cameras, voters)
    odds[held_out] = -odds[held_out]
    second = heard(odds, cameras, voters)
    assert overlap(first[held_out] > 0, silhouette(rig[held_out])) > 0.8
    for name in cameras:
        assert np.array_equal(first[name], second[name])
