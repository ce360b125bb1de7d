"""Chroma key: performers composited over screens with known masks."""

from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from tests.studio.masks.scenes import USUAL, disc, edge_error, filmed, over, overlap
from tests.support.errors import refuses
from tests.support.settings import refuses_setting
from v3studio.studio.capture import CaptureSettings
from v3studio.studio.footage import Footage, open_footage
from v3studio.studio.footage.checks import check_footage
from v3studio.studio.masks import chroma_key
from v3studio.studio.masks.chroma_key import chroma_mask, screen_behind
from v3studio.studio.masks.clean_plate import DifferenceSettings
from v3studio.studio.masks.despill import despill
from v3studio.studio.masks.screen_color import certain_screen, find_screen

GREEN, BLUE, RED, YELLOW = (60, 165, 80), (40, 80, 190), (190, 40, 45), (200, 180, 40)
SKIN, WHITE, DARK = (205, 150, 125), (225, 220, 215), (25, 25, 28)
SHAPE = (160, 240)
DISC = disc(SHAPE, 110, 80, 40)


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


def before(color: tuple[int, int, int], alpha: np.ndarray, front: object = SKIN, shadow: float = 0.5) -> np.ndarray:
    """The performer before a screen of this color."""
    return filmed(over(np.array(front), alpha, lit_screen(color, alpha, shadow)), 1)


def keyed(root: Path, **values: object) -> Footage:
    return open_footage(CaptureSettings(root=root, masks="chroma_key", **values))  # type: ignore[arg-type]


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
def test_the_performer_on_a_screen(make: SimpleNamespace, camera: str, frame: int, color: tuple[int, int, int]) -> None:
    front, alpha = performer_of(make, camera, frame)
    image = before(color, alpha, front)
    mask = chroma_mask(image, find_screen([image], camera), USUAL)
    assert overlap(mask, alpha) > 0.985
    assert np.abs(mask / 255 - alpha).mean() < 0.002


@pytest.mark.parametrize(
    ("color", "front"), [(GREEN, WHITE), (GREEN, SKIN), (BLUE, DARK), (RED, SKIN), (YELLOW, WHITE)]
)
def test_screens_of_any_color(color: tuple[int, int, int], front: tuple[int, int, int]) -> None:
    image = before(color, DISC, front)
    screen = find_screen([image], "cam")
    cosine = screen.color @ np.array(color) / np.linalg.norm(screen.color) / np.linalg.norm(color)
    assert cosine > 0.999
    mask = chroma_mask(image, screen, USUAL)
    assert overlap(mask, DISC) > 0.97
    assert np.abs(mask / 255 - DISC).mean() < 0.004


def test_edges_have_the_true_softness() -> None:
    alpha = disc(SHAPE, 110.3, 80.7, 40)
    image = before(GREEN, alpha, shadow=0.0)
    assert edge_error(chroma_mask(image, find_screen([image], "cam"), USUAL), alpha) < 0.5


def test_shadows_are_screen_by_default() -> None:
    alpha = disc(SHAPE, 80, 80, 40)
    image = before(GREEN, alpha, shadow=0.6)
    screen = find_screen([image], "cam")
    assert overlap(chroma_mask(image, screen, USUAL), alpha) > 0.97
    assert overlap(chroma_mask(image, screen, DifferenceSettings(mask_shadows="none")), alpha) < 0.9


def test_what_is_far_darker_than_a_shadow_is_no_screen() -> None:
    """Clothes of the screen's own color at a sixth of its brightness."""
    image = before(GREEN, DISC, tuple(0.16 * part for part in GREEN), shadow=0.0)
    mask = chroma_mask(image, find_screen([image], "cam"), USUAL)
    assert overlap(mask, DISC) > 0.97


def test_components_sensitivity_and_large_images(monkeypatch: pytest.MonkeyPatch) -> None:
    larger = disc(SHAPE, 70, 80, 40)
    image = before(GREEN, np.maximum(larger, disc(SHAPE, 190, 80, 12)))
    screen = find_screen([image], "cam")
    assert overlap(chroma_mask(image, screen, DifferenceSettings(mask_components=1)), larger) > 0.97
    # a color close to the screen's: sensitivity decides
    near = before(GREEN, DISC, (75, 150, 85), shadow=0.0)
    few, many = (
        (chroma_mask(near, screen, DifferenceSettings(mask_sensitivity=value)) > 127).sum() for value in (0.5, 4.0)
    )
    assert few < 0.1 * many
    monkeypatch.setattr(chroma_key, "WORK_SIDE", 320)  # larger images are reduced to this
    large = cv2.resize(DISC, (480, 320), interpolation=cv2.INTER_CUBIC).clip(0, 1)
    mask = chroma_mask(before(GREEN, large, shadow=0.0), screen, USUAL)
    assert mask.shape == large.shape
    assert overlap(mask, large) > 0.99


def test_an_image_without_a_screen(tmp_path: Path, make: SimpleNamespace) -> None:
    gray = filmed(over(np.array(SKIN), DISC, np.full((*SHAPE, 3), 120.0)), 1)
    make.image(tmp_path / "images" / "a" / "0.png", gray)
    footage = keyed(tmp_path)
    with refuses("mask.no_screen", camera="a", setting="capture.key_color") as caught:
        footage.mask("a", 0)
    assert caught.value.value < 0.12
    (problem,) = check_footage(footage)
    assert problem.code == "mask.no_screen"
    asked = keyed(tmp_path, key_color=(0.1, 0.7, 0.2))
    with refuses("mask.key_color_not_found", value=(0.1, 0.7, 0.2), camera="a", setting="capture.key_color"):
        asked.mask("a", 0)


@pytest.mark.parametrize("key", [(0.5, 0.5, 0.52), "green", (0.1, 2.0, 0.1)])
def test_invalid_key_colors(key: object) -> None:
    with refuses_setting("key_color"):
        CaptureSettings(root=Path("."), key_color=key)  # type: ignore[arg-type]


def test_a_given_key_color_wins_over_a_larger_area(tmp_path: Path, make: SimpleNamespace) -> None:
    """A red floor larger than the green screen; a garbage mask removes the floor."""
    alpha = disc(SHAPE, 110, 50, 35)
    image = before(GREEN, alpha, WHITE, shadow=0.0)
    image[95:] = filmed(np.broadcast_to(np.array(RED, float), (65, 240, 3)), 1)
    make.image(tmp_path / "images" / "a" / "3.png", image)
    kept = np.full((80, 120), 255, np.uint8)  # of half the size
    kept[46:] = 0
    make.image(tmp_path / "garbage" / "a.png", kept)
    footage = keyed(tmp_path, key_color=(0.25, 0.6, 0.3), garbage_masks="garbage/{camera}.png")
    assert overlap(footage.mask("a", 3), alpha) > 0.97
    assert tmp_path / "garbage" / "a.png" in footage.files()
    with refuses("mask.garbage_not_found", file=tmp_path, value="other/{camera}.png", setting="capture.garbage_masks"):
        keyed(tmp_path, garbage_masks="other/{camera}.png")


def test_garbage_masks_per_frame(tmp_path: Path, make: SimpleNamespace) -> None:
    image = before(GREEN, DISC, WHITE, shadow=0.0)
    for frame in (1, 2):
        make.image(tmp_path / "images" / "a" / f"{frame}.png", image)
        make.image(tmp_path / "images" / "b" / f"{frame}.png", image)
        make.image(tmp_path / "images" / "c" / f"{frame}.png", np.dstack([image, np.full(SHAPE, 254, np.uint8)]))
        make.image(tmp_path / "garbage" / "a" / f"{frame}.png", np.full(SHAPE, 255 * (frame == 2), np.uint8))
    footage = keyed(tmp_path, garbage_masks="garbage/{camera}/{frame}.png")
    assert footage.mask("a", 1).max() == 0
    assert np.array_equal(footage.mask("a", 2), footage.mask("b", 1))  # b has none: its whole image is used
    assert np.array_equal(footage.mask("c", 1), footage.mask("b", 1))


def test_the_screen_behind_the_performer_is_the_mean_of_what_is_near() -> None:
    """The screen is compared with Gaussian means at full size, of which wider ones count where the screen is far.
    Pixels that the performer's edge may reach, up to 3 pixels from the mask, count for nothing."""
    rows, columns = np.mgrid[0:160, 0:240]
    light = 120 + columns / 4 + 30 * np.sin(rows / 25)
    image = np.rint(light[..., None] * np.array([0.4, 1.0, 0.5]))
    distance = cv2.distanceTransform((DISC <= 0.5).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    plain = distance > 3
    image[~plain] = SKIN
    wanted = np.median(image[plain], axis=0)[None, None]
    for sigma in (96, 24, 6):
        share, *sums = (
            gaussian_filter(part, sigma, mode="mirror") for part in (1.0 * plain, *(plain * image.T.swapaxes(1, 2)))
        )
        trust = (share / (share + 0.02))[..., None]
        wanted = trust * np.stack(sums, -1) / np.maximum(share, 1e-6)[..., None] + (1 - trust) * wanted
    behind = screen_behind(image.astype(np.uint8), (DISC > 0.5).astype(np.uint8))
    assert np.abs(behind - wanted).max() < 1.5


def test_despill_restores_the_performers_color_at_the_outline_only() -> None:
    """With the exact mask and screen, and without noise, mixed pixels are solved up to rounding."""
    mask, screen = np.rint(255 * DISC).astype(np.uint8), np.full((*SHAPE, 3), GREEN, np.uint8)
    image = filmed(over(np.array(SKIN), DISC, screen), 1, noise=0.0)
    image[75:85, 105:115] = (90, 160, 90)  # a green badge in the middle
    cleaned = despill(image, mask, screen, np.array(GREEN))
    mixed = (DISC > 0.2) & (DISC < 0.95)
    assert np.abs(image[mixed] - np.array(SKIN, float)).max() > 60
    assert np.abs(cleaned[mixed] - np.array(SKIN, float)).max() < 4
    assert np.array_equal(cleaned[60:100, 90:130], image[60:100, 90:130])
    # of large performers, the outline is 1%: here 8 pixels
    large = np.rint(255 * disc((1000, 1000), 500, 500, 400)).astype(np.uint8)
    badge = np.full((*large.shape, 3), (90, 160, 90), np.uint8)
    changed = despill(badge, large, np.full_like(badge, GREEN), np.array(GREEN)) != badge
    assert 8 <= changed[500, large[500] == 255, 1][:400].sum() <= 10
    # screen light on the performer: green may not exceed red and blue
    tinted = filmed(over(np.array([120, 160, 110]), DISC, screen), 1, noise=0.0)
    red, green, blue = despill(tinted, mask, screen, np.array(GREEN))[mixed].T
    assert (green <= np.maximum(red, blue)).all()


WOOD, TABLE, CARPET = (150, 112, 85), (50, 88, 52), (46, 141, 123)
"""Colors of sets in real footage that fill much of the image but are no screens."""


@pytest.mark.parametrize(
    ("color", "name"),
    [
        (GREEN, "green"),
        (BLUE, "blue"),
        ((30, 80, 45), "green"),
        (WOOD, None),
        (TABLE, None),
        (CARPET, None),
        (RED, None),
    ],
)
def test_a_screen_is_seen_by_itself(color: tuple[int, int, int], name: str | None) -> None:
    """Also if it is only a part of the set; and only if most cameras see it."""
    image, wall = before(color, DISC), np.full((*SHAPE, 3), 25, np.uint8)
    floor = np.vstack([wall[:90], image[90:]])
    for images, expected in (([image, floor, wall, floor], name), ([image, wall, wall, floor], None)):
        found = certain_screen(images, "abcd")
        assert (found and found[0]) == expected
