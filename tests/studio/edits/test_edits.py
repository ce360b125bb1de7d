"""Edits of splats: what is removed, and where the rest goes."""

from dataclasses import replace
from itertools import pairwise
from typing import Any

import cv2
import numpy as np
import pytest
import torch
from pydantic import ValidationError

from tests.support.rigs import camera_at
from tests.support.splats import converted_splats
from v3studio.studio.edits import CropBox, EditList, Floaters, Ground, Paths, Region, RegionView, select
from v3studio.studio.edits.selection import distance_to_path, in_polygon
from v3studio.studio.formats.rigid_motion import placed
from v3studio.studio.rasterizer import rasterize
from v3studio.studio.similarity import Similarity, rotation_between
from v3studio.studio.stream import CapturePlace, StreamMetadata

TURN = rotation_between(np.array([0.3, 0.2, 1.0]), np.array([0.0, 1.0, 0.0]))
WORLD = Similarity(2.5, TURN, np.array([0.4, -1.0, 3.0]))
SIDE = camera_at("a", (3.0, 1.5, 2.0), (0.0, 0.0, 0.0))


def still(means: np.ndarray, opacities: np.ndarray | None = None, frames: int = 1, first: int = 0) -> Paths:
    opacity = np.ones(len(means)) if opacities is None else opacities
    return Paths(range(first, first + frames), np.stack([means] * frames), np.stack([opacity] * frames))


def test_a_moved_camera_sees_the_same_of_moved_splats() -> None:
    splats = converted_splats(3)
    before = rasterize(splats, SIDE, background=(0.2, 0.4, 0.6)).image
    after = rasterize(placed(splats, WORLD), WORLD.camera(SIDE), background=(0.2, 0.4, 0.6)).image
    assert torch.allclose(before, after, atol=2e-3)
    points = np.array([[0.1, 0.2, 0.3], [1.0, -1.0, 2.0]])
    pixels, depth = SIDE.project(points)
    seen, far = WORLD.camera(SIDE).project(WORLD.points(points))
    assert np.allclose(pixels, seen)
    assert np.allclose(far, WORLD.scale * depth)
    assert np.allclose(WORLD.inverse.points(WORLD.points(points)), points)
    assert np.allclose(WORLD.inverse.camera(WORLD.camera(SIDE)).world_to_camera, SIDE.world_to_camera)
    assert placed(splats, Similarity()) is splats


@pytest.mark.parametrize("end", [(0, 1, 0), (1, 2, 3), (-0.3, -0.2, -1), (0.3, 0.2, 1)])
def test_the_shortest_rotation(end: tuple[float, float, float]) -> None:
    start, end = np.array([0.3, 0.2, 1.0]), np.array(end, float)
    rotation = rotation_between(start, end)
    assert np.allclose(rotation @ rotation.T, np.eye(3))
    assert np.linalg.det(rotation) == pytest.approx(1)
    assert np.allclose(rotation @ start / np.linalg.norm(start), end / np.linalg.norm(end))


def test_where_a_stream_lies_in_its_take_is_read_back() -> None:
    place = StreamMetadata.from_json(StreamMetadata(capture=CapturePlace(7, WORLD)).to_json()).capture
    assert place.first_frame == 7
    assert np.allclose(place.world.points(np.eye(3)), WORLD.points(np.eye(3)))
    for wrong in (3, {}, {"scale": 0}, {**CapturePlace(0, WORLD).to_json(), "first_frame": -1}):
        assert StreamMetadata.from_json({"capture": wrong}).capture is None
    assert "capture" not in StreamMetadata().to_json()


def test_boxes_and_planes_take_what_is_outside_in_half_of_the_frames() -> None:
    means = np.zeros((4, 3, 3))
    means[:, 0] = (0.9, 0, 0)  # always inside
    means[2:, 1] = (1.1, 0, 0)  # outside in half of the frames
    means[3:, 2] = (1.1, 0, 0)  # in a quarter
    paths = Paths(range(4), means, np.ones((4, 3)))
    edits = EditList(crop=CropBox(center=(0, 0, 0), size=(2, 2, 2)))
    assert select(edits, paths).removed.tolist() == [False, True, False]
    turned = CropBox(center=(0, 0, 0), size=(2, 2, 2), rotation=(np.cos(np.pi / 8), 0, 0, np.sin(np.pi / 8)))
    assert turned.holds(np.array([[1.3, 0, 0], [0.9, 0.9, 0]])).tolist() == [True, False]
    assert np.allclose(np.sort(np.linalg.norm(turned.corners, axis=1)), np.sqrt(3))
    ground = EditList(ground=Ground(normal=(2, 0, 0), height=0.95))
    assert select(ground, paths).kinds["ground"].tolist() == [True, True, True]
    assert select(EditList(ground=Ground(normal=(2, 0, 0), height=0.5)), paths).counts["ground"] == 2


def region(**values) -> Region:
    view = RegionView.of(SIDE)
    x, y = (SIDE.width / 2, SIDE.height / 2)
    square = ((x - 15, y - 15), (x + 15, y - 15), (x + 15, y + 15), (x - 15, y + 15))
    return Region.model_validate({"view": view, "outline": square, **values})


def test_a_lasso_takes_what_one_sees_in_it() -> None:
    generator = np.random.default_rng(1)
    means = generator.normal(size=(500, 3)) * 0.4
    pixels, depth = SIDE.project(means)
    pixels -= (SIDE.width / 2, SIDE.height / 2)
    seen = (abs(pixels) < 15).all(1) & (depth > 0)
    assert 0 < seen.sum() < 500
    assert (select(EditList(regions=(region(),)), still(means)).removed == seen).all()
    middle = float(np.median(depth[seen]))
    near = select(EditList(regions=(region(far=middle),)), still(means)).removed
    assert (near == (seen & (depth <= middle))).all()
    path = [(SIDE.width / 2 + at, SIDE.height / 2 + at) for at in (-15, 15)]
    brushed = select(EditList(regions=(region(outline=path, radius=5.0),)), still(means)).removed
    from_line = np.abs(pixels[:, 0] - pixels[:, 1]) / np.sqrt(2)
    between = abs(pixels.sum(1)) < 30
    assert (brushed[between] == (from_line[between] <= 5)).all()
    # of other frames
    assert not select(EditList(regions=(region(frames=(5, 9)),)), still(means, first=2, frames=3)).removed.any()
    assert (select(EditList(regions=(region(frames=(4, 9)),)), still(means, first=2, frames=3)).removed == seen).all()


@pytest.mark.parametrize("frames", [None, (2, 2), (0, 99)])
def test_splats_that_were_drawn_around_are_removed_wherever_they_move(frames: tuple[int, int] | None) -> None:
    away = np.array([[0.0, 0, 0], [9.0, 9, 9]])
    paths = Paths(range(2, 5), np.stack([away, away[::-1], away]), np.ones((3, 2)))
    for drawn, removed in ((2, [True, False]), (3, [False, True]), (9, [True, False])):
        found = select(EditList(regions=(region(drawn=drawn, frames=frames),)), paths).removed
        assert found.tolist() == removed, "in other groups, what is mostly inside"


def test_polygons_and_paths_against_opencv() -> None:
    generator = np.random.default_rng(2)
    corners, points = generator.uniform(0, 100, (7, 2)), generator.uniform(0, 100, (300, 2))
    lone = corners[:3]  # of more corners, OpenCV rounds differently at crossings
    wanted = [cv2.pointPolygonTest(lone.astype(np.float32), tuple(map(float, point)), False) > 0 for point in points]
    assert in_polygon(lone, points).tolist() == wanted
    dense = np.concatenate([np.linspace(a, b, 400) for a, b in pairwise(corners)])
    nearest = np.linalg.norm(points[:, None] - dense, axis=2).min(1)
    assert np.allclose(distance_to_path(corners, points), nearest, atol=0.3)


def test_floaters_are_small_clusters_and_faint_splats() -> None:
    generator = np.random.default_rng(3)
    body = generator.uniform(-0.5, 0.5, (900, 3))
    clump = generator.uniform(-0.02, 0.02, (30, 3)) + np.array([2.0, 0, 0])
    lone = np.array([[0, 3.0, 0], [0, -50.0, 1e4]])
    means = np.concatenate([body, clump, lone])
    opacities = np.ones(len(means))
    opacities[:10] = 0.01
    selection = select(EditList(floaters=Floaters(share=0.05, distance=0.2)), still(means, opacities))
    assert np.flatnonzero(selection.kinds["loose"]).tolist() == list(range(900, 932))
    few = select(EditList(floaters=Floaters(splats=10, opacity=0.05, distance=0.2)), still(means, opacities))
    assert np.flatnonzero(few.kinds["loose"]).tolist() == [930, 931]
    assert np.flatnonzero(few.kinds["faint"]).tolist() == list(range(10))
    assert few.counts == {"crop": 0, "ground": 0, "regions": 0, "faint": 10, "loose": 2}
    # the largest cluster stays, however small the limit makes it
    assert select(EditList(floaters=Floaters(splats=10_000)), still(means)).removed.sum() < len(means)


def test_a_mask_is_cut_to_a_box_that_reaches_to_the_camera() -> None:
    """Its corners are projected far outside the image; against rays through the pixels."""
    camera = replace(SIDE, world_to_camera=np.eye(4))
    box = CropBox(center=(5, 0.1, 1), size=(10, 0.3, 1.99))
    x, y = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    rays = np.stack([(x - camera.K[0, 2]) / camera.K[0, 0], (y - camera.K[1, 2]) / camera.K[1, 1], np.ones_like(x)], -1)
    low, high = np.subtract(box.center, np.divide(box.size, 2)), np.add(box.center, np.divide(box.size, 2))
    ends = np.stack([low / rays, high / rays])
    met = ends.min(0).max(-1) <= ends.max(0).min(-1)
    seen = box.cut(camera, np.ones(x.shape, np.uint8)) > 0
    assert 0.2 < met.mean() < 0.9
    assert (seen == met).mean() > 0.98


@pytest.mark.parametrize(
    "values",
    [
        {"trim": {"first": 5, "last": 4}},
        {"crop": {"center": [0, 0, 0], "size": [1, 0, 1]}},
        {"crop": {"center": [0, 0, float("nan")], "size": [1, 1, 1]}},
        {"ground": {"normal": [0, 0, 0], "height": 0}},
        {"floaters": {}},
        {"world": {"scale": 0}},
        {"regions": [{"view": {"width": 4, "height": 4, "K": [[0] * 3] * 3, "world_to_camera": [[0] * 4] * 4},
                      "outline": [[0, 0], [1, 0], [1, 1]]}]},
        {"unknown": 1},
    ],
)  # fmt: skip
def test_what_makes_no_sense_is_refused(values: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        EditList.model_validate(values)
