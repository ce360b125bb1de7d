"""Every setting of the initial points changes them: none is read by nobody."""

import functools
import hashlib
from collections.abc import Callable
from dataclasses import replace

import pytest

from tests.studio.meshing.conftest import Shot, two_balls
from v3studio.studio.meshing import InitializeSettings, initialize_points
from v3studio.studio.settings import affected

BASE = {"points": 200, "resolution": 16, "max_faces": 400}
CHANGES = {"points": 201, "resolution": 24, "tolerance": 0.0, "max_faces": 200}


@pytest.fixture(scope="module")
def views() -> list[Shot]:
    """Of six cameras, one has a mask that lacks a part, and two see the right half of their images only."""
    shots = two_balls(6)
    broken = shots[1].mask.copy()
    broken[:55] = 0
    shots[1] = replace(shots[1], mask=broken)
    for number in (3, 5):
        shots[number] = shots[number].right_half()
    return shots


@pytest.fixture(scope="module")
def digest(views: list[Shot]) -> Callable[[InitializeSettings], str]:
    @functools.cache
    def made(settings: InitializeSettings) -> str:
        points = initialize_points(views, settings)
        return hashlib.sha256(points.points.tobytes() + points.colors.tobytes()).hexdigest()

    return made


def test_there_is_a_value_for_every_setting() -> None:
    assert set(CHANGES) == set(affected(InitializeSettings))


@pytest.mark.parametrize("name", CHANGES)
def test_the_setting_changes_the_points(name: str, digest: Callable[[InitializeSettings], str]) -> None:
    assert digest(InitializeSettings(**{**BASE, name: CHANGES[name]})) != digest(InitializeSettings(**BASE))
