"""The ground of a cast in the window. tests/web/test_package.py compares it with the page's."""

import numpy as np
import pytest
import torch

from pipelines.share.cast import GroundPlane
from pipelines.share.cast_ground import Ground, Shadow
from studio.cameras import Camera
from studio.edits.moving import moved
from studio.gaussians import Gaussians
from studio.similarity import Similarity

CAMERA = Camera.look_at((2.0, 3.0, 6.0), (2, 0, 0), (0, 1, 0), width=160, height=120, field_of_view=70)
PLANE = GroundPlane(color=(0.8, 0.4, 0.2), radius=7.0, shadow=0.5)
BOX = np.array([[-0.5, 0, -0.5], [0.5, 2, 0.5]])


def shadow(*means: tuple[float, float, float], world: Similarity | None = None) -> Shadow:
    """Of large splats at these means in the performer's coordinates."""
    count = len(means)
    quats, opacities = torch.tensor([[1.0, 0, 0, 0]]).repeat(count, 1), torch.full((count,), 0.9)
    sizes, sh = torch.tensor([[0.4, 0.4, 0.1]]).repeat(count, 1), torch.zeros(count, 1, 3)
    splats = Gaussians.from_activated(torch.tensor(means), quats, sizes, opacities, sh)
    return Shadow.of(moved(splats, world or Similarity()), BOX, world or Similarity(), PLANE.shadow)


def test_the_ground_is_a_disk_at_zero() -> None:
    pixels, depth = Ground(PLANE, ()).seen(CAMERA)
    rows, columns = np.mgrid[:120, :160].reshape(2, -1)
    places = np.column_stack([columns, rows]) + 0.5
    hit = np.isfinite(depth.ravel())
    points = CAMERA.unproject(places[hit], depth.ravel()[hit])
    np.testing.assert_allclose(points[:, 1], 0, atol=1e-3)
    assert 6.5 < np.hypot(points[:, 0], points[:, 2]).max() < 7.001
    assert 0.2 < hit.mean() < 0.9
    assert (pixels.reshape(-1, 3)[hit] == [204, 102, 51]).all()
    below = Camera.look_at((0, -1.0, 0), (0, -2, 0.1), (0, 0, 1), width=8, height=8)
    assert np.isinf(Ground(PLANE, ()).seen(below)[1]).all()


@pytest.mark.parametrize("degrees", [0, 90])
def test_a_shadow_is_below_what_is_near_the_ground(degrees: float) -> None:
    turn = np.deg2rad(degrees)
    rotation = np.array([[np.cos(turn), 0, np.sin(turn)], [0, 1, 0], [-np.sin(turn), 0, np.cos(turn)]])
    world = Similarity(2.0, rotation, np.array([3.0, 0, 1]))
    pixels, _ = Ground(PLANE, [shadow((0.2, 0.0, -0.1), (-0.3, 1.5, 0.3), world=world)]).seen(CAMERA)
    places = world.points(np.array([[0.2, 0, -0.1], [-0.3, 0, 0.3]]))
    (low, high), _ = CAMERA.project(places)
    light = pixels[..., 0] / 204
    assert light[int(low[1]), int(low[0])] < 0.75
    assert light[int(high[1]), int(high[0])] > 0.95  # of a splat high above the ground
    assert light[light > 0].min() >= 0.5 - 1 / 204


def test_who_does_not_stand_on_the_ground_has_no_shadow_there() -> None:
    lifted = shadow((0.0, 0.0, 0.0), world=Similarity(translation=np.array([0, 0.5, 0])))
    pixels, depth = Ground(PLANE, [lifted]).seen(CAMERA)
    assert (pixels[np.isfinite(depth)] == [204, 102, 51]).all()
