"""What single images say about the performer: screens that end, and shadows at the feet."""

import numpy as np

from tests.studio.masks.scenes import USUAL, disc, filmed, over, overlap
from v3studio.studio.masks.agreement.evidence import evidence_of, evidence_of_screen
from v3studio.studio.masks.clean_plate import Background
from v3studio.studio.masks.screen_color import find_screen

SHAPE = (160, 240)
CARPET, CLOTHES = np.array([46.0, 141.0, 123.0]), np.array([60.0, 55.0, 65.0])


def test_a_shadow_at_the_feet_on_a_carpet_is_not_the_performer() -> None:
    legs, shade = disc(SHAPE, 120, 60, 20, 50), disc(SHAPE, 125, 112, 30, 6)
    floor = np.broadcast_to(CARPET, (*SHAPE, 3))
    image = filmed(over(CLOTHES, legs, floor * (1 - 0.65 * shade)[..., None]), 1, 2.0)
    odds = evidence_of(image, [], Background(filmed(floor, 2, 2.0)), USUAL)
    assert overlap(odds > 0, legs) > 0.93
    assert (odds[(shade > 0.9) & (legs < 0.1)] < 0).mean() > 0.95


def test_beyond_the_edge_of_a_screen_nothing_is_known() -> None:
    """A green floor before black walls: legs are found, walls are not taken for a performer."""
    performer = disc(SHAPE, 120, 90, 18, 60)
    stage = np.broadcast_to(np.array([20.0, 22.0, 24.0]), (*SHAPE, 3)).copy()
    stage[80:] = (48, 96, 36)
    image = filmed(over(np.array([205.0, 150.0, 125.0]), performer, stage), 1, 2.0)
    odds = evidence_of_screen(image, find_screen([image], "a"), USUAL)
    rows = np.arange(SHAPE[0])[:, None]
    assert (odds[(performer > 0.9) & (rows > 100)] > 0).mean() > 0.95
    assert (odds[(performer < 0.1) & (rows > 84)] < 0).mean() > 0.98
    assert np.abs(odds[(performer < 0.1) & (rows < 60)]).max() < 0.5
