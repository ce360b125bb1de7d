"""Verdicts on rigs that are right, and on rigs that are wrong in known ways."""

from collections.abc import Callable
from dataclasses import replace
from itertools import combinations

import cv2
import numpy as np
import pytest

from tests.support.rigs import intrinsics, ring
from v3studio.studio.calibration.epipolar import PairMatches, fitting, match_images
from v3studio.studio.calibration.verdict import judge
from v3studio.studio.cameras import Camera

Cameras = dict[str, Camera]

FLIP = np.diag([1.0, -1.0, -1.0, 1.0])


@pytest.fixture(scope="module")
def rig() -> Cameras:
    K = intrinsics(500.0, (640, 360))
    cameras = ring(12, heights=[0.5, 1.5], target=(0, 0, 1), name="cam{:02d}", K=K, size=(640, 360))
    return {camera.name: camera for camera in cameras}


@pytest.fixture(scope="module")
def pairs(rig: Cameras) -> list[PairMatches]:
    """Noisy projections of points around the ring, seen by neighbors."""
    random = np.random.default_rng(0)
    points = random.uniform([-1.5, -1.5, -0.5], [1.5, 1.5, 2.5], (60, 3))
    matched = []
    names = list(rig)
    for first, second in combinations(range(12), 2):
        if (second - first) % 12 in (1, 2, 10, 11):
            seen = [rig[names[n]].project(points)[0] + random.normal(0, 0.3, (60, 2)) for n in (first, second)]
            matched.append(PairMatches(names[first], names[second], *seen))
    return matched


def posed(camera: Camera, change: Callable[[np.ndarray], np.ndarray]) -> Camera:
    return replace(camera, world_to_camera=change(camera.world_to_camera))


def exchanged(rig: Cameras, first: str, second: str) -> Cameras:
    return {**rig, first: replace(rig[second], name=first), second: replace(rig[first], name=second)}


def turned(degrees: float) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, :3] = cv2.Rodrigues(np.array([0, 0, np.radians(degrees)]))[0]
    return pose


def test_a_correct_rig_is_good(rig: Cameras, pairs: list[PairMatches]) -> None:
    verdict = judge(rig, pairs, dict.fromkeys(rig, 0.05))
    assert (verdict.grade, verdict.blamed) == ("good", "")
    assert min(camera.fits or 0.0 for camera in verdict.cameras.values()) > 0.99


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda _, camera: posed(camera, np.linalg.inv), "camera-to-world,"),
        (lambda _, camera: posed(camera, lambda pose: FLIP @ pose), "OpenGL"),
        (lambda _, camera: posed(camera, lambda pose: np.linalg.inv(FLIP @ pose)), "camera-to-world with"),
        (lambda _, camera: replace(camera, world_to_camera=np.c_[camera.rotation, np.zeros(3)]), "wrong"),
        (lambda _, camera: replace(camera, K=intrinsics(700.0, (640, 360))), "focal lengths"),
        (lambda _, camera: replace(camera, K=intrinsics(535.0, (640, 360))), "focal lengths 0.9"),
        (lambda n, camera: posed(camera, lambda pose: pose @ turned(40.0 * (n % 2))), "wrong"),
    ],
    ids=["camera to world", "OpenGL", "both", "at one place", "focal lengths", "focal lengths, a little", "folded"],
)
def test_a_wrong_rig_is_called_wrong_for_its_reason(
    rig: Cameras, pairs: list[PairMatches], change: Callable[[int, Camera], Camera], words: str
) -> None:
    verdict = judge({name: change(n, camera) for n, (name, camera) in enumerate(rig.items())}, pairs, None)
    assert (verdict.grade, verdict.blamed) == ("wrong", "cameras")
    assert words in verdict.reason


def test_single_cameras_are_named(rig: Cameras, pairs: list[PairMatches]) -> None:
    verdict = judge(exchanged(rig, "cam02", "cam07"), pairs, None)
    assert (verdict.grade, set(verdict.doubtful)) == ("usable", {"cam02", "cam07"})
    assert "cam02 and cam07 are exchanged" in verdict.reason

    zoomed = {**rig, "cam03": replace(rig["cam03"], K=intrinsics(600.0, (640, 360)))}
    verdict = judge(zoomed, pairs, None)
    assert verdict.doubtful == ("cam03",)
    assert "focal length 0.8" in verdict.reason


@pytest.mark.parametrize("second", ["cam03", "cam04", "cam08"])
def test_exchanged_cameras_with_few_matches_are_named(rig: Cameras, pairs: list[PairMatches], second: str) -> None:
    random, few = np.random.default_rng(0), []
    for pair in pairs:
        if "cam02" in (pair.first, pair.second):
            pixels = pair.second_pixels[:12].copy()
            pixels[:4] = random.uniform(0, 360, (4, 2))
            pair = PairMatches(pair.first, pair.second, pair.first_pixels[:12], pixels)
        few.append(pair)
    assert judge(rig, few, None).grade == "good"
    verdict = judge(exchanged(rig, "cam02", second), few, None)
    assert (verdict.grade, set(verdict.doubtful)) == ("usable", {"cam02", second})
    assert f"cam02 and {second} are exchanged" in verdict.reason
    turned_away = {**rig, second: posed(rig[second], lambda pose: pose @ turned(40.0))}
    assert "exchanged" not in judge(turned_away, few, None).reason


def test_masks_are_blamed_only_if_the_images_fit(rig: Cameras, pairs: list[PairMatches]) -> None:
    errors = dict.fromkeys(rig, 0.6)
    assert judge(rig, pairs, errors, list(rig)[:6]).blamed == "masks"
    assert judge(rig, pairs, {}).grade == "wrong", "no common volume"
    assert judge(rig, [], errors, list(rig)[:6]).blamed == "cameras or masks"
    few = judge(rig, pairs, errors, ["cam05"])
    assert (few.grade, few.doubtful, few.blamed) == ("usable", ("cam05",), "masks")
    both = judge(exchanged(rig, "cam02", "cam07"), pairs, errors, list(rig)[:6])
    assert (both.grade, both.blamed) == ("wrong", "cameras"), "misplaced cameras contradict all masks"


def test_without_matches_nothing_is_called_good(rig: Cameras) -> None:
    verdict = judge(rig, [], dict.fromkeys(rig, 0.05))
    assert (verdict.grade, verdict.blamed, verdict.fits) == ("usable", "", None)


@pytest.mark.parametrize(("shift", "grade"), [(0, "good"), (5, "usable")], ids=["one wall", "a wall that repeats"])
def test_matches_along_a_repeating_wall_do_not_blame_the_cameras(rig: Cameras, shift: int, grade: str) -> None:
    """Every fifth point of the wall looks the same; every second camera is matched with the next repetition."""
    x, z = (axis.ravel() for axis in np.meshgrid(np.linspace(-1.5, 1.5, 30), np.linspace(0, 2, 4), indexing="ij"))
    wall = np.stack([x, 0.2 * np.sin(7 * x + 5 * z), z], axis=1)
    names, pairs = list(rig), []
    for first, second in combinations(range(12), 2):
        apart = (second - first) % 12
        if apart in (1, 2, 10, 11):
            moved = 4 * shift if apart in (2, 10) else 0
            pixels = rig[names[first]].project(wall)[0], rig[names[second]].project(wall)[0]
            pairs.append(PairMatches(names[first], names[second], pixels[0][: 120 - moved], pixels[1][moved:]))
    verdict = judge(rig, pairs, dict.fromkeys(rig, 0.05))
    assert (verdict.grade, verdict.blamed) == (grade, "")


def test_images_are_matched_without_their_cameras() -> None:
    """A textured floor, seen by three cameras: each image is a homography of the texture. A fourth image is blank."""
    K = intrinsics(500.0, (640, 360))
    rig = list(ring(20, heights=[2.0], K=K, size=(640, 360)))[:3]
    texture = cv2.resize(np.random.default_rng(1).integers(0, 255, (90, 90, 3), np.uint8), (720, 720))
    to_floor = np.array([[4 / 720, 0, -2], [0, 4 / 720, -2], [0, 0, 1.0]])
    images = {
        c.name: cv2.warpPerspective(texture, c.K @ c.world_to_camera[:3][:, [0, 1, 3]] @ to_floor, (640, 360))
        for c in rig
    }
    pairs = match_images(images | {"blank": np.full((360, 640, 3), 90, np.uint8)})
    assert {(pair.first, pair.second) for pair in pairs} == {("cam0", "cam1"), ("cam0", "cam2"), ("cam1", "cam2")}
    counts = fitting({c.name: c for c in rig}, pairs)
    assert all(good > 0.9 * total for good, total in counts.values())
