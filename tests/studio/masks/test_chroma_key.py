"""Chroma key: performers composited over screens with known masks."""

from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from studio.capture import CaptureSettings, open_footage
from studio.capture.checks import check_footage
from studio.masks import chroma_key
from studio.masks.chroma_key import chroma_mask
from studio.masks.clean_plate import DifferenceSettings
from studio.masks.despill import despill
from studio.masks.screen_color import find_screen
from tests.support.errors import refuses
from tests.support.settings import refuses_setting

GREEN, BLUE, RED, YELLOW = (60, 165, 80), (40, 80, 190), (190, 40, 45), (200, 180, 40)


def iou(mask: np.ndarray, alpha: np.ndarray) -> float:
    ours, exact = mask >= 128, alpha >= 0.5
    return float((ours & exact).sum() / max((ours | exact).sum(), 1))


def lit_screen(color: tuple[int, int, int], alpha: np.ndarray, shadow: float = 0.5) -> np.ndarray:
    """(H, W, 3) screen with uneven light, wrinkles, and the performer's soft shadow."""
    height, width = alpha.shape
    rows, columns = np.mgrid[0:height, 0:width] / np.array([height, width]).reshape(2, 1, 1)
    light = 0.75 + 0.35 * columns - 0.2 * rows**2
    wrinkles = cv2.GaussianBlur(np.random.default_rng(3).normal(0, 1, alpha.shape), (0, 0), 9)
    light = light * (1 + 0.15 * wrinkles / np.abs(wrinkles).max())
    moved = cv2.warpAffine(alpha, np.float64([[1, 0, 25], [0, 1, 8]]), (width, height))
    light = light * (1 - shadow * cv2.GaussianBlur(moved, (0, 0), 5))
    return light[..., None] * np.array(color)


def compose(front: np.ndarray, alpha: np.ndarray, behind: np.ndarray, noise: float = 2.5) -> np.ndarray:
    image = alpha[..., None] * front + (1 - alpha[..., None]) * behind
    return np.clip(np.rint(image + np.random.default_rng(1).normal(0, noise, image.shape)), 0, 255).astype(np.uint8)


def disc(x: float = 110.0, y: float = 80.0, radius: float = 40.0) -> np.ndarray:
    """An exact soft disc, (160, 240) in 0..1."""
    columns, rows = np.meshgrid(np.arange(240) + 0.5, np.arange(160) + 0.5)
    return np.clip(radius - np.hypot(columns - x, rows - y) + 0.5, 0, 1)


def performer_of(make: SimpleNamespace, camera: str, frame: int) -> tuple[np.ndarray, np.ndarray]:
    """The sample capture's performer: colors, extrapolated over the soft edge, and exact mask in 0..1."""
    spec = CaptureSettings(root=make.sample, masks="files", mask_files="mattes/{camera}.mkv", cameras=(camera,))
    footage = open_footage(spec)
    image, alpha = footage.raw_image(camera, frame).astype(float), footage.raw_mask(camera, frame) / 255.0
    core = (alpha > 0.98).astype(float)
    weight = cv2.GaussianBlur(core, (0, 0), 2)
    outwards = cv2.GaussianBlur(image * core[..., None], (0, 0), 2) / np.maximum(weight, 1e-4)[..., None]
    return np.where(core[..., None] > 0, image, outwards), alpha


@pytest.mark.parametrize(
    ("camera", "frame", "color"), [("cam00", 0, GREEN), ("cam09", 7, BLUE), ("cam09", 7, (30, 80, 45))]
)
def test_the_sample_performer_on_a_screen(
    make: SimpleNamespace, camera: str, frame: int, color: tuple[int, int, int]
) -> None:
    front, alpha = performer_of(make, camera, frame)
    image = compose(front, alpha, lit_screen(color, alpha))
    mask = chroma_mask(image, find_screen([image], camera))
    assert iou(mask, alpha) > 0.985
    assert np.abs(mask / 255 - alpha).mean() < 0.002


@pytest.mark.parametrize(
    ("color", "front"),
    [
        (GREEN, (225, 220, 215)),
        (GREEN, (205, 150, 125)),
        (BLUE, (25, 25, 28)),
        (RED, (205, 150, 125)),
        (YELLOW, (225, 220, 215)),
    ],
)
def test_screens_of_any_color(color: tuple[int, int, int], front: tuple[int, int, int]) -> None:
    alpha = disc()
    image = compose(np.array(front), alpha, lit_screen(color, alpha))
    screen = find_screen([image], "cam")
    cosine = screen.color @ np.array(color) / np.linalg.norm(screen.color) / np.linalg.norm(color)
    assert cosine > 0.999
    mask = chroma_mask(image, screen)
    assert iou(mask, alpha) > 0.97
    assert np.abs(mask / 255 - alpha).mean() < 0.004


def test_edges_have_the_true_softness() -> None:
    alpha = disc(110.3, 80.7)
    image = compose(np.array([205, 150, 125]), alpha, lit_screen(GREEN, alpha, shadow=0.0))
    mask = chroma_mask(image, find_screen([image], "cam"))
    edge = (alpha > 0.05) & (alpha < 0.95)
    hard = np.abs((alpha > 0.5) - alpha)[edge].mean()
    assert np.abs(mask[edge] / 255 - alpha[edge]).mean() < 0.5 * hard


def test_shadows_are_screen_by_default() -> None:
    alpha = disc(80)
    image = compose(np.array([205, 150, 125]), alpha, lit_screen(GREEN, alpha, shadow=0.6))
    screen = find_screen([image], "cam")
    assert iou(chroma_mask(image, screen), alpha) > 0.97
    assert (
        iou(chroma_mask(image, screen, DifferenceSettings(mask_shadows="none")), alpha) < 0.9
    )  # the setting makes the difference


def test_components_sensitivity_and_large_images(monkeypatch: pytest.MonkeyPatch) -> None:
    alpha = np.maximum(disc(70), disc(190, 80, 12))
    image = compose(np.array([205, 150, 125]), alpha, lit_screen(GREEN, alpha))
    screen = find_screen([image], "cam")
    assert iou(chroma_mask(image, screen, DifferenceSettings(mask_components=1)), disc(70)) > 0.97
    # a color close to the screen's: sensitivity decides
    near = compose(np.array([75, 150, 85]), disc(), lit_screen(GREEN, disc(), shadow=0.0))
    found = [
        int((chroma_mask(near, screen, DifferenceSettings(mask_sensitivity=value)) > 127).sum()) for value in (0.5, 4.0)
    ]
    assert found[0] < 0.1 * found[1]
    monkeypatch.setattr(chroma_key, "WORK_SIDE", 320)  # larger images are reduced to this
    large = cv2.resize(disc(), (480, 320), interpolation=cv2.INTER_CUBIC).clip(0, 1)
    image = compose(np.array([205, 150, 125]), large, lit_screen(GREEN, large, shadow=0.0))
    mask = chroma_mask(image, screen)
    assert mask.shape == large.shape
    assert iou(mask, large) > 0.99


def test_an_image_without_a_screen(tmp_path: Path, make: SimpleNamespace) -> None:
    gray = compose(np.array([205, 150, 125]), disc(), np.full((160, 240, 3), 120.0))
    make.image(tmp_path / "images" / "a" / "0.png", gray)
    footage = open_footage(CaptureSettings(root=tmp_path, masks="chroma_key"))
    with refuses("mask.no_screen", camera="a", setting="capture.key_color") as caught:
        footage.mask("a", 0)
    assert str(caught.value).startswith("Camera 'a': no screen found; no saturated color dominates the image (")
    assert caught.value.value < 0.12
    (problem,) = check_footage(footage)
    assert problem.code == "mask.no_screen"
    asked = open_footage(CaptureSettings(root=tmp_path, masks="chroma_key", key_color=(0.1, 0.7, 0.2)))
    with refuses("mask.key_color_not_found", value=(0.1, 0.7, 0.2), camera="a", setting="capture.key_color") as caught:
        asked.mask("a", 0)
    assert "[0.10, 0.70, 0.20]" in str(caught.value)


@pytest.mark.parametrize("key", [(0.5, 0.5, 0.52), "green", (0.1, 2.0, 0.1)])
def test_invalid_key_colors(key: object) -> None:
    with refuses_setting("key_color"):
        CaptureSettings(root=Path("."), key_color=key)  # type: ignore[arg-type]


def test_a_given_key_color_wins_over_a_larger_area(tmp_path: Path, make: SimpleNamespace) -> None:
    """A red floor larger than the green screen; a garbage mask removes the floor."""
    alpha = disc(110, 50, 35)
    image = compose(np.array([225, 220, 215]), alpha, lit_screen(GREEN, alpha, shadow=0.0))
    image[95:] = compose(np.zeros(3), np.zeros((65, 240)), np.broadcast_to(np.array(RED, float), (65, 240, 3)))
    make.image(tmp_path / "images" / "a" / "3.png", image)
    kept = np.full((80, 120), 255, np.uint8)  # of half the size
    kept[46:] = 0
    make.image(tmp_path / "garbage" / "a.png", kept)
    spec = CaptureSettings(
        root=tmp_path,
        masks="chroma_key",
        key_color=(0.25, 0.6, 0.3),
        garbage_masks="garbage/{camera}.png",
    )
    footage = open_footage(spec)
    assert iou(footage.mask("a", 3), alpha) > 0.97
    assert tmp_path / "garbage" / "a.png" in footage.files()
    with refuses("mask.garbage_not_found", file=tmp_path, value="other/{camera}.png", setting="capture.garbage_masks"):
        open_footage(CaptureSettings(root=tmp_path, masks="chroma_key", garbage_masks="other/{camera}.png"))


def test_garbage_masks_per_frame(tmp_path: Path, make: SimpleNamespace) -> None:
    alpha = disc()
    image = compose(np.array([225, 220, 215]), alpha, lit_screen(GREEN, alpha, shadow=0.0))
    for frame in (1, 2):
        make.image(tmp_path / "images" / "a" / f"{frame}.png", image)
        make.image(tmp_path / "images" / "b" / f"{frame}.png", image)
        make.image(tmp_path / "garbage" / "a" / f"{frame}.png", np.full((160, 240), 255 * (frame == 2), np.uint8))
    footage = open_footage(
        CaptureSettings(root=tmp_path, masks="chroma_key", garbage_masks="garbage/{camera}/{frame}.png")
    )
    assert footage.mask("a", 1).max() == 0
    assert np.array_equal(footage.mask("a", 2), footage.mask("b", 1))  # b has none: its whole image is used


def test_despill_restores_the_performers_color_at_the_outline_only() -> None:
    """With the exact mask and screen, and without noise, mixed pixels are solved up to rounding."""
    alpha = disc()
    screen = np.broadcast_to(np.array(GREEN, float), (160, 240, 3))
    front = np.array([205.0, 150.0, 125.0])
    image = compose(front, alpha, screen, noise=0.0)
    image[75:85, 105:115] = (90, 160, 90)  # a green badge in the middle
    cleaned = despill(image, np.rint(255 * alpha).astype(np.uint8), screen.astype(np.uint8), np.array(GREEN))
    mixed = (alpha > 0.2) & (alpha < 0.95)
    assert np.abs(image[mixed] - front).max() > 60
    assert np.abs(cleaned[mixed] - front).max() < 4
    assert np.array_equal(cleaned[60:100, 90:130], image[60:100, 90:130])
    # screen light on the performer: green may not exceed red and blue
    tinted = compose(np.array([120.0, 160.0, 110.0]), alpha, screen, noise=0.0)
    cleaned = despill(tinted, np.rint(255 * alpha).astype(np.uint8), screen.astype(np.uint8), np.array(GREEN))
    assert (cleaned[mixed][:, 1] <= np.maximum(cleaned[mixed][:, 0], cleaned[mixed][:, 2])).all()
