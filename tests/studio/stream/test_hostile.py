"""Mutated streams whose sizes and checksums fit: each is rejected with a sentence, or its frames are finite."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.support.hostile_streams import Files, mutate, mutate_sound, read_all
from tests.support.streams import bake_numbered, contents
from v3studio.studio.stream import BakeSettings

NUMBERS = st.integers(0, 2**32)
quick = settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.too_slow])


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Files:
    folder = tmp_path_factory.mktemp("hostile")
    sound = np.sin(np.arange(9600) / 20).astype(np.float32)[:, None] / 4
    return contents(bake_numbered(folder / "stream", (3, 2), 25, 40, BakeSettings(preset="ultrafast"), sound))


def test_the_stream_itself_is_read(files: Files) -> None:
    assert read_all(files) == "read"


@given(number=NUMBERS)
@quick
def test_a_mutated_stream_is_rejected_or_finite(files: Files, number: int) -> None:
    read_all(mutate(files, number)[1])  # raises whatever is no StudioError


@given(number=NUMBERS)
@quick
def test_mutated_sound_is_rejected_or_played(files: Files, number: int) -> None:
    read_all(mutate_sound(files, number))
