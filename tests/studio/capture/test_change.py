"""Change of a performer between two images: independent of position and size, sensitive to appearance."""

import cv2
import numpy as np
import pytest

from studio.capture.change import LOOK_SIDE, change, look


def scene(center: tuple[int, int], radius: int, angle: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """A disc with a red and a blue half, rotated by `angle` degrees."""
    image = np.full((240, 320, 3), 90, np.uint8)
    mask = np.zeros((240, 320), np.uint8)
    cv2.circle(mask, center, radius, 255, -1)
    cv2.ellipse(image, center, (radius, radius), angle, 0, 180, (220, 20, 20), -1)
    cv2.ellipse(image, center, (radius, radius), angle, 180, 360, (20, 20, 220), -1)
    return image, mask


def test_position_and_size_do_not_matter() -> None:
    base = look(*scene((80, 100), 40))
    assert base.shape == (LOOK_SIDE, LOOK_SIDE, 4)
    moved, larger = look(*scene((230, 140), 40)), look(*scene((150, 120), 80))
    assert moved is not None
    assert larger is not None
    assert change(base, base) == 0
    assert change(base, moved) < 0.02
    assert change(base, larger) < 0.08


def test_change_grows_with_rotation() -> None:
    looks = [look(*scene((160, 120), 60, angle)) for angle in (0, 20, 60, 180)]
    assert all(one is not None for one in looks)
    found = [change(looks[0], one) for one in looks]  # type: ignore[arg-type]
    assert found == sorted(found)
    # rotated by 180 degrees all colors are swapped: (|220 - 20| twice, 0) / (220 twice, 20, 255 of the mask)
    assert found[3] == pytest.approx(400 / (220 + 20 + 220 + 255), abs=0.05)


def test_an_invisible_performer() -> None:
    image, mask = scene((160, 120), 60)
    assert look(image, np.zeros_like(mask)) is None
    assert change(np.zeros((4, 4, 4), np.float32), np.zeros((4, 4, 4), np.float32)) == 0
