"""Cameras of a file that are named otherwise than those of the footage."""

from dataclasses import replace

import numpy as np
import pytest

from tests.support.errors import refuses
from tests.support.rigs import STRAIGHT
from v3studio.studio.cameras import Rig
from v3studio.studio.capture import CaptureSettings
from v3studio.studio.footage import rig_of_footage

NAMES = STRAIGHT.names


def moments(spread: float, form: str) -> Rig:
    """Each camera at two moments, whose centers differ by about `spread`."""
    rng = np.random.default_rng(0)
    cameras = []
    for camera in STRAIGHT:
        for moment in (0, 3):
            pose = camera.world_to_camera.copy()
            pose[:3, 3] += rng.normal(0, spread, 3)
            cameras.append(replace(camera, name=form.format(camera.name, moment), world_to_camera=pose))
    return Rig(tuple(cameras))


@pytest.mark.parametrize("form", ["{}/{:03d}", "images/{}/{:03d}", "{}_frame_{:05d}", "{1:03d}_{0}"])
def test_several_poses_of_a_fixed_camera(form: str) -> None:
    rig = rig_of_footage(moments(1e-3, form), CaptureSettings(), NAMES)
    assert rig.names == NAMES
    np.testing.assert_allclose(rig.centers, STRAIGHT.centers, atol=0.01)
    assert any(f"{2 * len(NAMES)} poses" in note for note in rig.notes)
    with refuses("camera.moves", camera=NAMES[0]):
        rig_of_footage(moments(1.0, form), CaptureSettings(), NAMES)


@pytest.mark.parametrize("chosen", [None, slice(None, -1)])
def test_footage_that_counts_from_1_and_a_rig_from_0(chosen: slice | None) -> None:
    """Also if settings leave out the camera that the rig does not have by name."""
    count = len(NAMES)
    known = [f"view{number + 1}" for number in range(count)]
    names = known if chosen is None else known[chosen]
    spec = CaptureSettings(cameras=tuple(names) if chosen is not None else ())
    own = Rig(tuple(replace(camera, name=f"view{number}") for number, camera in enumerate(STRAIGHT)))
    rig = rig_of_footage(own, spec, names, (), known)
    np.testing.assert_array_equal(rig.centers, STRAIGHT.centers[: len(names)])
    assert any("'view1' of the footage is 'view0'" in note for note in rig.notes)


def test_advice_does_not_shift_poses() -> None:
    """Names that may be shifted are to be given, not left out."""
    own = Rig(tuple(replace(camera, name=f"view{number}") for number, camera in enumerate(STRAIGHT)))
    names = [f"view{number}" for number in range(1, len(NAMES) + 2)]
    with refuses("calibration.camera_missing") as caught:
        rig_of_footage(own, CaptureSettings(), names)
    assert "capture.cameras" not in caught.value.fix
