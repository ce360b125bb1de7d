"""Masks compared with exact ones, for the sample capture and for synthetic scenes."""

from pathlib import Path
from types import SimpleNamespace
from unittest.mock import Mock

import cv2
import numpy as np

from tests.studio.masks.scenes import USUAL, disc, edge_error, filmed, over, overlap
from v3studio.studio.camera_files import read_rig
from v3studio.studio.capture import CaptureSettings
from v3studio.studio.footage import open_footage
from v3studio.studio.footage.checks import check_footage
from v3studio.studio.masks.clean_plate import Background, difference_mask
from v3studio.studio.masks.median_background import cached_background, estimate_background

SHAPE = (160, 240)
NOBODY = np.zeros(SHAPE)


def test_clean_plates_of_the_sample_capture(make: SimpleNamespace) -> None:
    spec = CaptureSettings(root=make.sample, masks="clean_plate")
    footage = open_footage(spec, read_rig(make.sample / "cameras.json"), evaluation_masks="mattes/{camera}.mkv")
    for camera, frame in (("cam00", 0), ("cam05", 29), ("cam12", 20)):
        ours, exact = footage.mask(camera, frame), footage.evaluation_mask(camera, frame)
        assert overlap(ours, exact) > 0.84
        assert np.abs(ours.astype(float) - exact).mean() / 255 < 0.015


def test_sample_masks_agree_with_the_exact_surface(make: SimpleNamespace) -> None:
    """Masks, meshes and cameras of the sample are consistent: every vertex projects into the mask or its border."""
    rig = read_rig(make.sample / "cameras.json")
    footage = open_footage(CaptureSettings(root=make.sample), rig, evaluation_masks="mattes/{camera}.mkv")
    data = (make.sample / "meshes" / "000000.ply").read_bytes()
    header, body = data.split(b"end_header\n", 1)
    count = int(header.split(b"element vertex ")[1].split()[0])
    vertices = np.frombuffer(body, "<f4", 3 * count).reshape(-1, 3)
    for camera in ("cam01", "cam12"):
        pixels, depth = rig[camera].project(vertices)
        inside = (depth > 0) & (pixels > 1).all(1) & (pixels < (639, 359)).all(1)
        grown = cv2.dilate(footage.evaluation_mask(camera, 0), np.ones((3, 3), np.uint8))
        columns, rows = np.floor(pixels[inside]).astype(int).T
        assert (grown[rows, columns] > 0).mean() > 0.999


def set_of() -> np.ndarray:
    """An empty set with some texture."""
    texture = cv2.GaussianBlur(np.random.default_rng(5).normal(0, 60, (*SHAPE, 3)).astype(np.float32), (0, 0), 4)
    return np.clip(np.linspace(90, 150, SHAPE[0])[:, None, None] + texture, 0, 255)


def shot(empty: np.ndarray, alpha: np.ndarray, seed: int) -> np.ndarray:
    return filmed(over(np.array([200.0, 60.0, 50.0]), alpha, empty), seed, 2.0)


def test_edges_have_the_true_softness() -> None:
    empty, alpha = set_of(), disc(SHAPE, 100.3, 80.7, 24)
    assert edge_error(difference_mask(shot(empty, alpha, 2), Background(shot(empty, NOBODY, 1)), USUAL), alpha) < 0.6


def test_shadows_on_a_colorful_floor_are_not_the_performer() -> None:
    empty, alpha = set_of() * np.array([0.6, 0.7, 1.1]), disc(SHAPE, 100, 70, 24)
    shade = 1 - 0.35 * cv2.GaussianBlur(disc(SHAPE, 150, 120, 26).astype(np.float32), (0, 0), 5)
    image = shot(empty * shade[..., None], alpha, 2)
    assert overlap(difference_mask(image, Background(shot(empty, NOBODY, 1)), USUAL), alpha) > 0.95


def test_the_set_is_estimated_although_it_is_covered_most_of_the_time() -> None:
    """The performer stays in one place for two thirds of the time, so a median would show them there."""
    empty = set_of()
    places = [(60 + 3 * np.sin(2.1 * i), 80 + 2 * np.cos(1.7 * i)) for i in range(20)]
    places += [(60 + 12.0 * i, 80.0) for i in range(1, 11)]
    images = [shot(empty, disc(SHAPE, *place, 22), i) for i, place in enumerate(places)]
    median = np.median(np.stack(images), axis=0)
    covered = disc(SHAPE, 60, 80, 18) > 0
    assert np.abs(median - empty)[covered].mean() > 25
    estimated = estimate_background(images.__getitem__, range(30))
    assert np.abs(estimated.plate - empty)[covered].mean() < 5
    for index in (3, 25):
        mask = difference_mask(images[index], estimated, USUAL)
        assert overlap(mask, disc(SHAPE, *places[index], 22)) > 0.95


def test_estimated_sets_are_cached_and_damaged_files_replaced(tmp_path: Path) -> None:
    images = [shot(set_of(), disc(SHAPE, 40 + 15 * i, 80, 24), i) for i in range(12)]
    estimate = Mock(side_effect=lambda: estimate_background(images.__getitem__, range(12)))
    first, again = (cached_background(tmp_path, "k", estimate) for _ in range(2))
    assert estimate.call_count == 1
    assert np.array_equal(first.plate, again.plate)
    assert np.array_equal(first.known, again.known)
    (file,) = tmp_path.iterdir()
    whole = file.read_bytes()
    middle = len(whole) // 2
    for count, damaged in enumerate((whole[:1000], whole[:middle] + b"\xff" * 40 + whole[middle + 40 :]), 2):
        file.write_bytes(damaged)
        cached_background(tmp_path, "k", estimate)
        assert estimate.call_count == count


def test_static_footage_has_empty_masks(tmp_path: Path, make: SimpleNamespace) -> None:
    for frame in range(12):
        make.image(tmp_path / "images" / "a" / f"{frame}.png", shot(set_of(), NOBODY, frame))
    footage = open_footage(CaptureSettings(root=tmp_path))
    assert "estimated from the footage" in footage.description
    (problem,) = check_footage(footage)
    assert (problem.code, problem.fields) == ("mask.empty", {"camera": "a", "frames": tuple(range(12))})
