"""Masks of a ball that moves through a textured room, damaged on purpose."""

from collections.abc import Mapping

import numpy as np
import pytest

from tests.studio.masks.scenes import USUAL, ball, filmed, over
from tests.support.rigs import ring
from v3studio.studio.cameras import FootageView
from v3studio.studio.comparison import CheckedView, MaskContradiction, behind, contradicting_masks
from v3studio.studio.comparison.contradictions import doubted
from v3studio.studio.footage.empty_set import filled, outside

RIG = ring(8, radius=3.0, heights=(0.0, 1.0))
FRAMES = range(6)
BALL = 0.45
Masks = dict[int, dict[str, np.ndarray]]


def plate(name: str) -> np.ndarray:
    texture = np.random.default_rng(RIG.names.index(name)).uniform(60, 200, (12, 16, 3))
    return np.kron(texture, np.ones((10, 10, 1))).astype(np.uint8)


def exact() -> Masks:
    return {
        frame: {camera.name: ball(camera, np.array([0.1 * frame - 0.3, 0, 0]), BALL) for camera in RIG}
        for frame in FRAMES
    }


def image(name: str, mask: np.ndarray, frame: int) -> np.ndarray:
    front = np.full((*mask.shape, 3), (230, 40, 20))
    return filmed(over(front, mask.astype(float), plate(name)), frame)


def checked(masks: Masks, plates: Mapping[str, np.ndarray | None]) -> set[tuple[str, int, str]]:
    truth = exact()

    def view(frame: int, name: str) -> CheckedView:
        shown = FootageView(RIG[name], image(name, truth[frame][name], frame), masks[frame][name] * np.uint8(255))
        return CheckedView.of(shown, plates[name], USUAL)

    frames = ((frame, {name: view(frame, name) for name in RIG.names}) for frame in FRAMES)
    return {(each.kind, each.frame, each.camera) for each in contradicting_masks(frames)}


def without_band(mask: np.ndarray) -> np.ndarray:
    """The mask without a fifth of its height."""
    rows = np.flatnonzero(mask.any(1))
    cut = mask.copy()
    cut[rows[0] + 2 * len(rows) // 5 : rows[0] + 3 * len(rows) // 5] = False
    return cut


def test_a_view_doubts_what_its_mask_lacks_and_has_too_much() -> None:
    name = RIG.names[0]
    truth, room = exact()[0][name], plate(RIG.names[0])
    view = image(name, truth, 0)
    assert doubted(view, truth * np.uint8(255), room, USUAL).sum() < 0.1 * truth.sum()
    mask = without_band(truth)
    band = truth & ~mask
    rows, columns = np.nonzero(truth)
    lamp = np.zeros_like(truth)
    lamp[rows.min() - 12 : rows.min(), columns.min() : columns.max()] = True
    found = doubted(view, (mask | lamp) * np.uint8(255), room, USUAL)
    assert (found & band).sum() > 0.7 * band.sum()
    assert (found & lamp).sum() > 0.7 * (lamp & ~truth).sum()
    assert (found & truth & ~band).sum() < 0.1 * truth.sum()


def test_what_all_masks_of_a_frame_lack_is_missing_there_only() -> None:
    plates = {name: plate(name) for name in RIG.names}
    assert checked(exact(), plates) == set()
    masks = exact()
    for frame in (0, 3):
        masks[frame] = {name: without_band(mask) for name, mask in masks[frame].items()}
    assert checked(masks, plates) == {("missing", frame, name) for frame in (0, 3) for name in RIG.names}


def test_what_equals_the_set_in_all_frames_is_extra() -> None:
    masks, name = exact(), RIG.names[2]
    for frame in FRAMES:
        masks[frame][name][10:30, 10:30] = True
    assert checked(masks, {name: plate(name) for name in RIG.names}) == {("extra", frame, name) for frame in FRAMES}


def test_without_a_set_one_mask_is_compared_with_the_hull_of_the_others() -> None:
    none = dict.fromkeys(RIG.names)
    assert checked(exact(), none) == set()
    masks, name = exact(), RIG.names[5]
    masks[4][name] = without_band(masks[4][name])
    assert checked(masks, none) == {("missing", 4, name)}


def test_the_set_is_what_damaged_masks_leave_out() -> None:
    truth, name = exact(), RIG.names[0]
    images = [image(name, truth[frame][name], frame) for frame in FRAMES]
    masks = [
        (truth[frame][name] if frame % 3 else without_band(truth[frame][name])) * np.uint8(255) for frame in FRAMES
    ]
    estimate = outside(images, masks)
    known = estimate[..., 3] > 0
    assert 0.5 < known.mean() < 1
    assert not known[np.all([truth[frame][name] for frame in FRAMES], axis=0)].any(), "always covered"
    assert np.abs(estimate[..., :3].astype(int) - plate(name))[known].max() < 12
    assert filled(estimate)[..., :3][~known].max() < 215, "not as red as the performer"


@pytest.mark.parametrize("mask_has_them", [True, False])
def test_the_performer_is_where_the_mask_or_the_difference_is(mask_has_them: bool) -> None:
    name = RIG.names[0]
    truth = exact()[0][name]
    mask = truth * np.uint8(255) if mask_has_them else np.zeros(truth.shape, np.uint8)
    back = behind(image(name, truth, 0), mask, plate(name), USUAL)
    assert (back.performer & truth).sum() / (back.performer | truth).sum() > 0.85
    assert np.abs(255 * back.image - plate(name)).mean() < 2


def test_shares_are_of_the_performer() -> None:
    masks = exact()
    masks[1] = {name: without_band(mask) for name, mask in masks[1].items()}
    views = {
        name: CheckedView.of(
            FootageView(RIG[name], image(name, exact()[1][name], 1), masks[1][name] * np.uint8(255)), plate(name), USUAL
        )
        for name in RIG.names
    }
    found = contradicting_masks([(1, views)])
    assert all(isinstance(each, MaskContradiction) for each in found)
    assert {each.camera: each.share for each in found} == pytest.approx(dict.fromkeys(RIG.names, 0.25), abs=0.06)
