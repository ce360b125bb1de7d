"""Splats of a wall before cameras of different colors."""

import numpy as np
import pytest
import torch

from tests.studio.scenery.test_depths import WALL, before_wall
from v3studio.studio.rasterizer import rasterize
from v3studio.studio.scenery import set_splats
from v3studio.studio.scenery.depths import DepthMap
from v3studio.studio.scenery.set_splats import first_points, in_the_air, plate_psnr, train_set

GAINS = {"cam0": 0.7, "cam3": 0.9}


@pytest.fixture
def wall(monkeypatch: pytest.MonkeyPatch) -> tuple[list, dict[str, np.ndarray], list[DepthMap]]:
    """Cameras, their plates, of which some are darker, and the true depths."""
    cameras, plates = before_wall()
    for name, gain in GAINS.items():
        plates[name] = (plates[name] * gain).astype(np.uint8)
    maps = []
    for camera in cameras:
        rows, columns = np.indices((camera.height, camera.width)) + 0.5
        rays = np.stack([columns, rows, np.ones(rows.shape)], -1) @ np.linalg.inv(camera.K).T @ camera.rotation
        depth = (WALL - camera.center[2]) / rays[..., 2]
        maps.append(DepthMap(camera, depth.astype(np.float32), np.ones(depth.shape, bool)))
    monkeypatch.setattr(set_splats, "_POINTS", 4000)
    few = {"keyframe_iterations": 60, "densify_from": 20, "densify_until": 50, "densify_every": 10}
    few |= {"densify_max_splats": 5000, "prune_finetune_iterations": 20}
    monkeypatch.setattr(set_splats, "SETTINGS", set_splats.SETTINGS.replace(**few))
    return cameras, plates, maps


def test_colors_of_cameras_are_found_where_they_see_the_same(wall: tuple) -> None:
    _, plates, maps = wall
    first = first_points(maps, plates)
    assert torch.allclose(torch.stack(list(first.matrices.values())).mean(0), torch.eye(3, 4).double(), atol=1e-9)
    gray = torch.tensor([0.4, 0.4, 0.4, 1.0], dtype=torch.float64)
    seen = {name: float((matrix @ gray).mean()) for name, matrix in first.matrices.items()}
    for name, gain in GAINS.items():
        assert seen[name] / seen["cam1"] == pytest.approx(gain, abs=0.05)
    assert np.abs(first.means[:, 2].numpy() - WALL).max() < 1e-3


def test_a_wall_is_learned_and_what_is_not_reliable_is_not(wall: tuple) -> None:
    cameras, plates, maps = wall
    held_out, *others = cameras[2], *cameras[:2], *cameras[3:]
    truth = plates.pop(held_out.name)
    ghost = plates["cam1"].copy()
    ghost[30:60, 40:80] = (255, 0, 0)  # a performer whom no mask had, in a plate that says so
    plates["cam1"] = np.dstack([ghost, np.full(ghost.shape[:2], 255, np.uint8)])
    plates["cam1"][30:60, 40:80, 3] = 0
    maps = [each for each in maps if each.camera.name != held_out.name]
    first = first_points(maps, plates)
    splats = train_set(plates, others, first, maps, cameras, dilation=0.1)
    assert splats.sh_degree == 0
    assert splats.dilation == 0.1
    figures = plate_psnr(splats, others, plates, first.matrices)
    assert set(figures) == set(plates)
    assert min(figures.values()) > 18
    image = rasterize(splats, held_out, torch.zeros(3)).image.clamp(0, 1).numpy()
    error = np.abs(image - truth / 255)[8:-8, 8:-8]
    assert error.mean() < 0.1
    red = image[..., 0] - image[..., 1:].max(-1)
    assert red.max() < 0.5


def test_what_is_before_cameras_and_before_the_wall_is_in_the_air(wall: tuple) -> None:
    cameras, _, maps = wall
    ahead = cameras[0].center + 0.3 * cameras[0].forward
    means = np.array([[0, 0, WALL], [0, 0, 1.5], ahead, [0, 0, WALL + 1], [0, 9.0, 2.0]])
    assert in_the_air(means, maps, cameras).tolist() == [False, True, True, False, False]
    beside = cameras[0].center + 0.3 * cameras[0].forward + 1.0 * cameras[0].rotation[1]
    assert in_the_air(np.array([beside] * 2), maps, cameras, np.array([0.0, 0.5])).tolist() == [False, True]
