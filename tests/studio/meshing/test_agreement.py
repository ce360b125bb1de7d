"""Which masks contradict the others."""

from dataclasses import replace

import numpy as np
import pytest

from tests.studio.meshing.conftest import two_balls
from v3studio.studio.meshing.agreement import frame_that_fits, mask_verdicts
from v3studio.studio.meshing.silhouettes import silhouettes


@pytest.mark.parametrize(("scale", "origin"), [(1.0, (0, 0, 0)), (0.01, (5, -3, 2))])
def test_correct_masks_agree(scale: float, origin: tuple[float, float, float]) -> None:
    verdicts = mask_verdicts(silhouettes(two_balls(9, scale, origin)), 4)
    assert len(verdicts) == 9
    assert max(verdict.more for verdict in verdicts) < 0.01
    assert not any(verdict.wrong for verdict in verdicts)


@pytest.mark.parametrize("what", ["empty", "of another camera", "shifted"])
def test_a_wrong_mask_is_named(what: str) -> None:
    views = two_balls(9)
    mask = views[4].mask
    wrong = {"empty": np.zeros_like(mask), "of another camera": views[8].mask, "shifted": np.roll(mask, 40, 1)}
    views[4] = replace(views[4], mask=np.ascontiguousarray(wrong[what]))
    assert [verdict.camera for verdict in mask_verdicts(silhouettes(views), 4) if verdict.wrong] == ["cam04"]


@pytest.mark.parametrize("pixels", [1e9, 4000.0])
def test_the_place_of_a_contradiction_is_named(pixels: float) -> None:
    """Places are in pixels of the view, also if the masks are compared at a smaller size."""
    views = two_balls(9)
    mask = views[4].mask.copy()
    patch = (4, 6, 44, 30)
    assert not mask[patch[1] : patch[3], patch[0] : patch[2]].any()
    mask[patch[1] : patch[3], patch[0] : patch[2]] = 255
    views[4] = replace(views[4], mask=mask)
    verdicts = mask_verdicts(silhouettes(views, max_pixels=pixels * 9), 4)
    box = next(verdict.box for verdict in verdicts if verdict.camera == "cam04")
    assert box is not None
    assert np.abs(np.subtract(box, patch)).max() <= 6


def test_a_performer_near_a_camera_does_not_contradict() -> None:
    """There, the points of the volume are many pixels apart."""
    views = two_balls(9)
    here = views[4].camera
    pose = here.world_to_camera.copy()
    pose[2, 3] -= 0.75 * float(np.linalg.norm(here.center))
    near = replace(here, world_to_camera=pose)
    points = np.random.default_rng(0).normal(size=(400_000, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    points = np.concatenate([0.5 * points, np.array([0.55, 0.1, 0.25]) + 0.2 * points])
    column, row = np.floor(near.project(points)[0]).astype(int).T
    mask = np.zeros_like(views[4].mask)
    shown = (column >= 0) & (row >= 0) & (column < near.width) & (row < near.height)
    mask[row[shown], column[shown]] = 255
    views[4] = replace(views[4], camera=near, mask=mask)
    verdicts = mask_verdicts(silhouettes(views), 4)
    assert next(verdict.more for verdict in verdicts if verdict.camera == "cam04") < 0.01
    assert not any(verdict.wrong for verdict in verdicts)


def test_the_frame_of_a_late_camera_is_found() -> None:
    views = two_balls(9)
    right = views[4].mask
    views[4] = replace(views[4], mask=np.roll(right, 20, 1))
    shapes = silhouettes(views)
    others = {frame: np.roll(right, 20 + 5 * frame, 1) for frame in range(-8, 9) if frame}
    assert frame_that_fits(shapes, "cam04", others, 4) == pytest.approx(-4, abs=1)
    assert frame_that_fits(shapes, "cam04", {3: others[3]}, 4) is None
