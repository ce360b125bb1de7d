"""Performers cut out on a plain color."""

from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from tests.studio.masks.scenes import overlap
from tests.support.errors import refuses
from v3studio.studio.capture import CaptureSettings
from v3studio.studio.footage import open_footage
from v3studio.studio.footage.checks import check_footage
from v3studio.studio.masks.plain_background import plain_color, plain_mask

SIZE = 160


def performer() -> tuple[np.ndarray, np.ndarray]:
    """Colors (H, W, 3) float and coverage (H, W) 0..1: a textured ring, with the background in its hole."""
    y, x = np.mgrid[:SIZE, :SIZE] + 0.5
    radius = np.hypot(x - SIZE / 2, y - SIZE / 2)
    alpha = np.clip(50.5 - radius, 0, 1) * np.clip(radius - 19.5, 0, 1)
    colors = np.stack([130 + 50 * np.sin(x / 5), 90 + 40 * np.sin(y / 7), 100 + 0 * x], -1)
    return colors, alpha


def before(color: int) -> np.ndarray:
    colors, alpha = performer()
    return np.rint(colors * alpha[..., None] + color * (1 - alpha[..., None])).astype(np.uint8)


@pytest.mark.parametrize("color", [0, 255])
@pytest.mark.parametrize("quality", [None, 90])
def test_masks_of_performers_on_a_plain_color(color: int, quality: int | None) -> None:
    image = before(color)
    if quality:
        image = cv2.imdecode(cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])[1], cv2.IMREAD_COLOR)
    background = plain_color(image)
    assert background.tolist() == [color] * 3
    mask, truth = plain_mask(image, background) / 255, performer()[1]
    assert overlap(mask, truth) > (0.99 if quality is None else 0.96)
    assert np.abs(mask - truth).mean() < (0.005 if quality is None else 0.015)
    assert mask[SIZE // 2, SIZE // 2] == 0


def test_auto_detects_it_and_cleans_the_outline(tmp_path: Path, make: SimpleNamespace) -> None:
    for camera in ("a", "b"):
        make.image(tmp_path / "images" / camera / "000000.png", before(255))
    footage = open_footage(CaptureSettings(root=tmp_path))
    assert "plain background" in footage.description
    image, mask = footage.image("a", 0).astype(float), footage.mask("a", 0)
    colors, _ = performer()
    mixed = (mask > 100) & (mask < 220)
    assert mixed.any()
    # in the files these pixels are half white
    assert np.abs(image - colors)[mixed].mean() < 0.4 * np.abs(before(255) - colors)[mixed].mean()
    assert not check_footage(footage)


def test_another_background_is_refused(tmp_path: Path, make: SimpleNamespace) -> None:
    noise = np.random.default_rng(0).integers(0, 255, (SIZE, SIZE, 3)).astype(np.uint8)
    make.image(tmp_path / "images" / "a.png", noise)
    make.image(tmp_path / "images" / "b.png", before(0))
    footage = open_footage(CaptureSettings(root=tmp_path))
    assert "Masks: not found" in footage.description
    with refuses("mask.no_source", setting="capture.masks"):
        footage.mask("a", 0)
    assert [problem.code for problem in check_footage(footage)] == ["mask.no_source"]  # once, not for each camera
    footage = open_footage(CaptureSettings(root=tmp_path, masks="plain"))
    with refuses("mask.not_plain", camera="a", setting="capture.masks"):
        footage.mask("a", 0)


def test_performers_cut_off_by_the_edge(tmp_path: Path, make: SimpleNamespace) -> None:
    """Camera b cuts off two sides, c hides nearly the whole border, d does not see the performer yet."""
    whole, half = before(255), SIZE // 2
    corner, middle = np.s_[: half + 5, : half + 5], np.s_[half - 30 : half + 30, 40:100]
    images = whole, whole[corner], whole[middle], np.full_like(whole, 255), whole[:, ::-1], whole[::-1]
    for camera, image in zip("abcdef", images, strict=True):
        make.image(tmp_path / "images" / f"{camera}.png", image)
    truth = performer()[1]
    for masks in ("plain", "auto"):
        footage = open_footage(CaptureSettings(root=tmp_path, masks=masks))
        assert "plain background" in footage.description
        assert ("chosen automatically" in footage.description) == (masks == "auto")
        for camera, seen in (("b", corner), ("c", middle)):
            assert np.abs(footage.mask(camera, 0) / 255 - truth[seen]).mean() < 0.01
        assert not footage.mask("d", 0).any()
