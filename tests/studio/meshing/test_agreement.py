"""Which masks contradict the others."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from studio.meshing.agreement import contradicting, frame_that_fits, mask_agreement
from studio.meshing.silhouettes import Silhouettes


@pytest.mark.parametrize(("scale", "origin"), [(1.0, (0, 0, 0)), (0.01, (5, -3, 2))])
def test_correct_masks_agree(
    two_balls: Callable[..., list[Any]], scale: float, origin: tuple[float, float, float]
) -> None:
    agreement = mask_agreement(Silhouettes(two_balls(9, scale, origin)), 4)
    assert len(agreement) == 9
    assert max(one.missing for one in agreement.values()) < 0.01
    assert not contradicting(agreement)


@pytest.mark.parametrize("what", ["empty", "of another camera", "shifted"])
def test_a_wrong_mask_is_named(two_balls: Callable[..., list[Any]], what: str) -> None:
    views = two_balls(9)
    mask = views[4].mask
    wrong = {
        "empty": np.zeros_like(mask),
        "of another camera": views[8].mask,
        "shifted": np.roll(mask, 40, 1),
    }
    views[4] = replace(views[4], mask=np.ascontiguousarray(wrong[what]))
    assert contradicting(mask_agreement(Silhouettes(views), 4)) == ["cam04"]


def test_the_frame_of_a_late_camera_is_found(two_balls: Callable[..., list[Any]]) -> None:
    views = two_balls(9)
    right = views[4].mask
    views[4] = replace(views[4], mask=np.roll(right, 20, 1))
    shapes = Silhouettes(views)
    others = {frame: np.roll(right, 20 + 5 * frame, 1) for frame in range(-8, 9) if frame}
    assert frame_that_fits(shapes, "cam04", others, 4) == pytest.approx(-4, abs=1)
    assert frame_that_fits(shapes, "cam04", {3: others[3]}, 4) is None
