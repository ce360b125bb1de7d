from collections.abc import Callable

import numpy as np

from tests.studio.masks.scenes import ball, filmed, overlap
from v3studio.studio.cameras import orbit
from v3studio.studio.masks.corrections import REACH, Corrections, MaskClick

SIDE, FRAMES = 160, REACH + 2
BODY, HEAD = 0.5, 0.3
CAMERAS = {camera.name: camera for camera in orbit((0, 0, 0), 4.0, 8, width=SIDE, height=SIDE, up=(0, 0, 1))}
NAMES = tuple(CAMERAS)
CLICKED, OTHER, AFAR = NAMES[0], NAMES[1], NAMES[3]


def centers(frame: int) -> tuple[np.ndarray, np.ndarray]:
    """Where body and head are in a frame."""
    move = np.array([0.02 * frame, 0.01 * frame, -0.2])
    return move, move + np.array([0.0, 0.0, 0.7])


def image(camera: str, frame: int) -> np.ndarray:
    """A blue body with a red head before a gray set."""
    rows, columns = np.mgrid[:SIDE, :SIDE]
    picture = np.repeat((120 + 12 * np.sin(0.9 * rows) * np.sin(0.7 * columns))[..., None], 3, axis=2)
    for center, radius, color in zip(centers(frame), (BODY, HEAD), ((40, 60, 190), (200, 60, 40)), strict=True):
        picture[ball(CAMERAS[camera], center, radius)] = color
    return filmed(picture, seed=frame)


def body(camera: str, frame: int) -> np.ndarray:
    return 255 * ball(CAMERAS[camera], centers(frame)[0], BODY).astype(np.uint8)


def whole(camera: str, frame: int) -> np.ndarray:
    return body(camera, frame) | 255 * ball(CAMERAS[camera], centers(frame)[1], HEAD).astype(np.uint8)


def corrections(
    mask: Callable[[str, int], np.ndarray], performer: bool, voters: tuple[str, ...] = NAMES
) -> Corrections:
    """A click on the head, in the first frame."""
    (place,), _ = CAMERAS[CLICKED].project(centers(0)[1][None])
    click = MaskClick(camera=CLICKED, frame=0, at=(place[0], place[1]), performer=performer)
    return Corrections([click], range(FRAMES), image, mask, CAMERAS, voters)


def test_a_click_brings_a_part_back_in_near_frames_and_in_cameras_that_lack_it_too() -> None:
    for lacking in (NAMES[:4], NAMES):  # some of the cameras see where it is, or none

        def mask(camera: str, frame: int, lacking: tuple[str, ...] = lacking) -> np.ndarray:
            return body(camera, frame) if camera in lacking else whole(camera, frame)

        by_hand = corrections(mask, performer=True)
        for camera, frame in ((CLICKED, 0), (CLICKED, REACH), (OTHER, 0), (AFAR, 2)):
            before, exact = mask(camera, frame), whole(camera, frame)
            after = by_hand.corrected(camera, frame, before)
            assert overlap(before, exact) < 0.8
            assert overlap(after, exact) > 0.9, (camera, frame, len(lacking))
        beyond = body(CLICKED, REACH + 1)
        np.testing.assert_array_equal(by_hand.corrected(CLICKED, REACH + 1, beyond), beyond)


def test_a_click_takes_a_part_away_in_near_frames_and_other_cameras() -> None:
    by_hand = corrections(whole, performer=False)
    for camera, frame in ((CLICKED, 0), (CLICKED, 2), (OTHER, 0), (AFAR, 2)):
        assert overlap(by_hand.corrected(camera, frame, whole(camera, frame)), body(camera, frame)) > 0.9


def test_masks_that_are_right_stay() -> None:
    by_hand = corrections(whole, performer=True)
    for camera in NAMES:
        np.testing.assert_array_equal(by_hand.corrected(camera, 0, whole(camera, 0)), whole(camera, 0))


def test_a_click_on_a_held_out_camera_changes_no_other() -> None:
    by_hand = corrections(body, performer=True, voters=NAMES[1:])
    assert overlap(by_hand.corrected(CLICKED, 0, body(CLICKED, 0)), whole(CLICKED, 0)) > 0.95
    np.testing.assert_array_equal(by_hand.corrected(OTHER, 0, body(OTHER, 0)), body(OTHER, 0))
