"""The card of a body that moves before a ring of cameras: each deliberate mistake is named, and nothing without one."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from benchmarks.mistakes import Images, mistakes
from tests.support.rigs import ring
from v3studio.studio.cameras import Camera
from v3studio.studio.card.card import Measured
from v3studio.studio.card.picture import draw

SIZE, FRAMES = (320, 240), 25
NAMED = {
    "poses inverted": "inverted",
    "poses mirrored": "mirrored",
    "rotations transposed": "transposed",
    "places as translations": "center",
    "names shifted by one": "names",
    "K halved": "pixels",
    "masks off by one frame": "frames",
    "masks inverted": "inverted",
    "masks of one part": "object",
    "one camera 1 frame late": "late",
    "one camera 1/2 frame late": "late",
    "one camera 1/3 frame late": "late",
    "one camera drops frames": "rate",
}


def filmed() -> tuple[dict[str, Camera], Images, Images]:
    """Eight cameras, and images and masks of the hull of some points that swing and turn, before a plain set."""
    random = np.random.default_rng(0)
    rig = {camera.name: camera for camera in ring(8, heights=[0.4, 1.2], size=SIZE, focal=330.0)}
    points = random.normal(0, 1, (14, 3)) * [0.22, 0.3, 0.55]
    images: Images = {name: [] for name in rig}
    masks: Images = {name: [] for name in rig}
    for frame in range(FRAMES):
        turn = cv2.Rodrigues(np.array([0.3 * np.sin(frame / 3), 0.2, frame / 5]))[0]
        place = np.array([np.sin(frame / 4), np.cos(frame / 5), 0.4 * np.sin(frame / 3)]) * 0.35
        for name, camera in rig.items():
            pixels = camera.project(points @ turn.T + place)[0] - 0.5
            corners = np.round(16 * cv2.convexHull(pixels.astype(np.float32))).astype(np.int32)
            mask = np.zeros(SIZE[::-1], np.uint8)
            cv2.fillConvexPoly(mask, corners, 255, cv2.LINE_AA, 4)
            images[name].append(np.where(mask[..., None] > 127, np.uint8(200), np.uint8(60)).repeat(3, 2))
            masks[name].append(mask)
    return rig, images, masks


@pytest.fixture(scope="module")
def measured() -> dict[str, tuple[str, Measured]]:
    return {what: (cause, kept.measured({})) for what, cause, kept in mistakes(*filmed())}


def test_what_is_right_is_not_called_wrong(measured: dict[str, tuple[str, Measured]]) -> None:
    right = [card.card for cause, card in measured.values() if not cause]
    assert len(right) == 3
    assert [check.grade for check in right[0].checks] == ["good", "good", "good", "not enough to judge"]
    assert not any(check.causes for card in right for check in card.checks)
    assert max(map(abs, right[0].late.values())) <= 0.1


@pytest.mark.parametrize(("what", "cause"), NAMED.items())
def test_a_mistake_is_named(measured: dict[str, tuple[str, Measured]], what: str, cause: str) -> None:
    card = measured[what][1].card
    assert card.is_wrong
    assert cause in {named for check in card.checks if check.grade == "wrong" for named in check.causes}


def test_lateness_is_measured_in_frames(measured: dict[str, tuple[str, Measured]]) -> None:
    for what, frames in (("1 frame", 1), ("1/2 frame", 1 / 2), ("1/3 frame", 1 / 3)):
        late = measured[f"one camera {what} late"][1].card.late
        assert sorted(late.values())[-1] == pytest.approx(frames, abs=0.1)


def test_the_picture_shows_masks_and_what_the_cameras_agree_on(measured: dict[str, tuple[str, Measured]]) -> None:
    right = measured["none"][1]
    picture, without = draw(right), draw(replace(right, cameras={}))
    assert (picture == (255, 180, 0)).all(-1).any()
    assert (picture != without).any()
