"""Every setting of the initial points changes them: none is read by nobody."""

import functools
import hashlib
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from studio.cameras import ViewLike
from studio.meshing import InitializeSettings, initialize_points
from studio.settings import affected

BASE = {"points": 200, "resolution": 16, "max_faces": 400}
CHANGES: dict[str, Any] = {
    "points": 201,
    "resolution": 24,
    "tolerance": 0.0,
    "max_faces": 200,
}


@pytest.fixture(scope="module")
def views(two_balls: Callable[..., list[ViewLike]]) -> list[Any]:
    """Of six cameras, one has a mask that lacks a part, and two see the right half of their images only."""
    shots: list[Any] = two_balls(6)
    broken = shots[1].mask.copy()
    broken[:55] = 0
    shots[1] = replace(shots[1], mask=broken)
    for number in (3, 5):
        camera, half = shots[number].camera, shots[number].camera.width // 2
        shots[number] = replace(
            shots[number],
            camera=camera.cropped(half, 0, camera.width - half, camera.height),
            image=shots[number].image[:, half:],
            mask=shots[number].mask[:, half:],
        )
    return shots


@pytest.fixture(scope="module")
def digest(views: list[Any]) -> Callable[[InitializeSettings], str]:
    @functools.cache
    def made(settings: InitializeSettings) -> str:
        found = initialize_points(views, settings)
        return hashlib.sha256(found.points.tobytes() + found.colors.tobytes()).hexdigest()

    return made


def test_there_is_a_value_for_every_setting() -> None:
    assert set(CHANGES) == set(affected(InitializeSettings))


@pytest.mark.parametrize("name", CHANGES)
def test_the_setting_changes_the_points(name: str, digest: Callable[[InitializeSettings], str]) -> None:
    assert digest(InitializeSettings(**{**BASE, name: CHANGES[name]})) != digest(InitializeSettings(**BASE))
