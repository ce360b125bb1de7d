"""The empty set behind a performer who hardly moves, estimated again outside of masks that cameras agree on."""

import cv2
import numpy as np
import pytest

from tests.studio.masks.scenes import overlap
from v3studio.studio.capture.settings import DifferenceSettings
from v3studio.studio.masks.agreement.empty_set import cover, uncovered
from v3studio.studio.masks.agreement.evidence import evidence_of
from v3studio.studio.masks.clean_plate import Background

HEIGHT, WIDTH = 120, 200
STANDS = (60, 60, 60, 60, 130)
"""Columns at which the performer is in five frames."""


def wall() -> np.ndarray:
    texture = cv2.GaussianBlur(np.random.default_rng(3).normal(0, 60, (HEIGHT, WIDTH, 3)), (0, 0), 3)
    return np.clip(120 + texture, 0, 255)


def performer(column: int) -> np.ndarray:
    """(H, W) bool."""
    mask = np.zeros((HEIGHT, WIDTH), bool)
    mask[30:110, column - 15 : column + 15] = True
    return mask


def filmed(number: int) -> np.ndarray:
    noise = np.random.default_rng(number).normal(0, 2, (HEIGHT, WIDTH, 3))
    image = np.where(performer(STANDS[number])[..., None], (125.0, 118.0, 112.0), wall())
    return np.clip(image + noise, 0, 255).astype(np.uint8)


@pytest.fixture(scope="module")
def first() -> Background:
    """A set as a camera estimates it: the performer is part of it."""
    plate = np.median([filmed(number) for number in range(5)], axis=0).astype(np.uint8)
    everywhere = np.ones((HEIGHT, WIDTH), bool)
    return Background(plate, everywhere, ~everywhere)


def again(first: Background, masks: list[np.ndarray]) -> Background:
    return uncovered(first, [filmed(number) for number in range(len(masks))], [cover(mask) for mask in masks])


def test_the_set_is_seen_where_the_performer_has_left(first: Background) -> None:
    behind = again(first, [performer(column) for column in STANDS])
    stood, off = performer(60), np.abs(first.plate - wall()).mean(-1)
    assert off[stood].mean() > 5, "the first estimate shows the performer"
    assert np.abs(behind.plate - wall()).mean(-1)[stood].mean() < 2
    assert behind.agreed is not None
    assert behind.agreed.all()


def test_a_performer_who_stands_still_is_found_before_the_set_that_cameras_agree_on(first: Background) -> None:
    neighbors, exact = [filmed(1), filmed(2)], performer(60)
    behind = again(first, [performer(column) for column in STANDS])
    alone, agreed = (evidence_of(filmed(0), neighbors, plate, DifferenceSettings()) for plate in (first, behind))
    overlaps = [overlap(odds > 0, exact) for odds in (alone, agreed)]
    assert overlaps[1] > max(0.8, overlaps[0])
