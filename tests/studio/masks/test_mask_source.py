"""Masks compared with exact ones, for the sample capture and for synthetic scenes."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np

from studio.cameras import Rig
from studio.capture import CaptureSettings, open_footage
from studio.capture.checks import check_footage
from studio.masks.clean_plate import difference_mask
from studio.masks.median_background import cached_background, estimate_background


def iou(mask: np.ndarray, truth: np.ndarray) -> float:
    ours, exact = mask >= 128, truth >= 128
    return float((ours & exact).sum() / max((ours | exact).sum(), 1))


def test_clean_plates_of_the_sample_capture(make: SimpleNamespace, sample_rig: Rig) -> None:
    spec = CaptureSettings(root=make.sample, masks="clean_plate")
    footage = open_footage(spec, sample_rig, evaluation_masks="mattes/{camera}.mkv")
    assert len(footage.camera_names) == 16
    assert len(footage.frames) == 30
    overlaps, errors = [], []
    for camera, frame in (("cam00", 0), ("cam05", 29), ("cam12", 20)):
        ours, exact = footage.mask(camera, frame), footage.evaluation_mask(camera, frame)
        overlaps.append(iou(ours, exact))
        errors.append(np.abs(ours.astype(float) - exact).mean() / 255)
    assert np.mean(overlaps) > 0.98
    assert min(overlaps) > 0.97
    assert np.mean(errors) < 0.004


def test_sample_masks_agree_with_the_exact_surface(make: SimpleNamespace, sample_rig: Rig) -> None:
    """Masks, meshes and cameras of the sample are consistent: every vertex projects into the mask or its border."""
    import cv2

    footage = open_footage(CaptureSettings(root=make.sample), sample_rig, evaluation_masks="mattes/{camera}.mkv")
    data = (make.sample / "meshes" / "000012.ply").read_bytes()
    header, body = data.split(b"end_header\n", 1)
    count = int(header.split(b"element vertex ")[1].split()[0])
    vertices = np.frombuffer(body, "<f4", 3 * count).reshape(-1, 3)
    for camera in ("cam01", "cam12"):
        pixels, depth = sample_rig[camera].project(vertices)
        inside = (depth > 0) & (pixels > 1).all(1) & (pixels < (639, 359)).all(1)
        grown = cv2.dilate(footage.evaluation_mask(camera, 12), np.ones((3, 3), np.uint8))
        columns, rows = np.floor(pixels[inside]).astype(int).T
        assert (grown[rows, columns] > 0).mean() > 0.999


def set_of(width: int = 240, height: int = 160) -> np.ndarray:
    """An empty set with some texture."""
    rng = np.random.default_rng(5)
    import cv2

    texture = cv2.GaussianBlur(rng.normal(0, 60, (height, width, 3)).astype(np.float32), (0, 0), 4)
    ground = np.linspace(90, 150, height)[:, None, None] + texture
    return np.clip(ground, 0, 255)


def performer(width: int, height: int, x: float, y: float, radius: float = 24) -> np.ndarray:
    """An exact soft disc, (H, W) in 0..1."""
    columns, rows = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    return np.clip(radius - np.hypot(columns - x, rows - y) + 0.5, 0, 1)


def compose(empty: np.ndarray, alpha: np.ndarray, noise: float, seed: int) -> np.ndarray:
    color = np.array([200.0, 60.0, 50.0])
    image = alpha[..., None] * color + (1 - alpha[..., None]) * empty
    return np.clip(np.rint(image + np.random.default_rng(seed).normal(0, noise, image.shape)), 0, 255).astype(np.uint8)


def test_edges_have_the_true_softness() -> None:
    empty, alpha = set_of(), performer(240, 160, 100.3, 80.7)
    mask = difference_mask(compose(empty, alpha, 2.0, 2), compose(empty, 0 * alpha, 2.0, 1))
    edge = (alpha > 0.05) & (alpha < 0.95)
    hard = np.abs((alpha > 0.5) - alpha)[edge].mean()
    assert np.abs(mask[edge] / 255 - alpha[edge]).mean() < 0.6 * hard


def test_shadows_on_a_colorful_floor_are_not_the_performer() -> None:
    import cv2

    empty, alpha = set_of() * np.array([0.6, 0.7, 1.1]), performer(240, 160, 100, 70)
    shade = 1 - 0.35 * cv2.GaussianBlur(performer(240, 160, 150, 120, 26).astype(np.float32), (0, 0), 5)
    image = compose(empty * shade[..., None], alpha, 2.0, 2)
    plate = compose(empty, 0 * alpha, 2.0, 1)
    assert iou(difference_mask(image, plate), 255 * alpha) > 0.95


def test_the_set_is_estimated_although_it_is_covered_most_of_the_time() -> None:
    """The performer stays in one place for two thirds of the time, so a median would show them there."""
    empty = set_of()
    places = [(60 + 3 * np.sin(2.1 * i), 80 + 2 * np.cos(1.7 * i)) for i in range(20)]
    places += [(60 + 12.0 * i, 80.0) for i in range(1, 11)]
    images = [compose(empty, performer(240, 160, x, y, 22), 2.0, i) for i, (x, y) in enumerate(places)]
    median = np.median(np.stack(images), axis=0)
    covered = performer(240, 160, 60, 80, 18) > 0
    assert np.abs(median - empty)[covered].mean() > 25
    found = estimate_background(images.__getitem__, range(30))
    assert np.abs(found.plate - empty)[covered].mean() < 5
    for index in (3, 25):
        mask = difference_mask(images[index], found.plate, None, found.known, found.doubtful, found.colors)
        assert iou(mask, 255 * performer(240, 160, *places[index], 22)) > 0.95


def test_estimated_sets_are_cached_and_damaged_files_replaced(tmp_path: Path) -> None:
    images = [compose(set_of(), performer(240, 160, 40 + 15 * i, 80), 2.0, i) for i in range(12)]
    calls = []

    def make_it():  # type: ignore[no-untyped-def]
        calls.append(1)
        return estimate_background(images.__getitem__, range(12))

    first = cached_background(tmp_path, "k", make_it)
    again = cached_background(tmp_path, "k", make_it)
    assert len(calls) == 1
    assert np.array_equal(first.plate, again.plate)
    assert np.array_equal(first.known, again.known)
    (file,) = tmp_path.iterdir()
    file.write_bytes(file.read_bytes()[:1000])
    cached_background(tmp_path, "k", make_it)
    assert len(calls) == 2


def test_static_footage_has_empty_masks(tmp_path: Path, make: SimpleNamespace) -> None:
    empty = set_of()
    for frame in range(12):
        make.image(tmp_path / "images" / "a" / f"{frame}.png", compose(empty, np.zeros((160, 240)), 2.0, frame))
    footage = open_footage(CaptureSettings(root=tmp_path))
    assert "estimated from the footage" in footage.description
    (problem,) = check_footage(footage)
    assert problem.code == "mask.empty"
    assert problem.fields == {"camera": "a", "frames": tuple(range(12))}
