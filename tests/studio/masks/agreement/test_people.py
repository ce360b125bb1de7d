"""A model that sees each person alone."""

from unittest.mock import Mock

import numpy as np

from v3studio.studio.masks.agreement.people import odds_of_people

PEOPLE = (slice(40, 100), slice(0, 25)), (slice(20, 60), slice(200, 215))
"""Rows and columns; the first one stands at the border."""


def test_a_model_sees_a_square_around_each_person() -> None:
    """It finds where the image is red, which is more exact than what it is told."""
    image, rough = np.zeros((120, 240, 3), np.uint8), np.zeros((60, 120), bool)
    for rows, columns in PEOPLE:
        image[rows, columns] = 200, 0, 0
        rough[rows.start // 2 : rows.stop // 2, columns.start // 2 : columns.stop // 2 - 2] = True
    image[70:, 130:150] = 200, 0, 0  # is in nobody's square
    rough[0, 60] = True  # too small for a person
    seen = []

    def red(part: np.ndarray) -> np.ndarray:
        seen.append(part.shape)
        return (part[..., 0] > 100).astype(np.float32)

    odds = odds_of_people(image, rough, red)
    assert all(shape[0] == shape[1] for shape in seen)
    assert [round(shape[0] / 10) for shape in sorted(seen)] == [4, 5, 6, 8]  # each of them with two margins
    exact = np.zeros(image.shape[:2], bool)
    for person in PEOPLE:
        exact[person] = True
    assert np.array_equal(odds > 3, exact)
    assert np.abs(odds[:, 110:170]).max() == 0
    assert (odds[40:100, 25:30] < -3).all()


def test_without_people_a_model_is_not_asked() -> None:
    model = Mock()
    assert not odds_of_people(np.zeros((8, 8, 3), np.uint8), np.zeros((8, 8), bool), model).any()
    model.assert_not_called()


def test_a_dark_image_is_brightened_for_the_model() -> None:
    """Black hair before a black wall."""
    solid, shown = np.zeros((40, 40), bool), []
    solid[10:30, 10:30] = True

    def model(part: np.ndarray) -> np.ndarray:
        shown.append(part)
        return np.ones(part.shape[:2], np.float32)

    for wall in (12, 120):
        odds_of_people(np.where(solid[..., None], wall + 16, wall).repeat(3, 2).astype(np.uint8), solid, model)
    dark, bright = shown[0].astype(int), shown[2]  # of two looks at each
    assert dark.max() - dark.min() > 24
    assert set(np.unique(bright)) == {120, 136}
