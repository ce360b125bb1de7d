"""Assertions on the setting that a model rejects."""

import contextlib
from collections.abc import Iterator

import pytest

from v3studio.studio.errors import StudioError


@contextlib.contextmanager
def refuses_setting(*names: str) -> Iterator[None]:
    """Assert that the block raises one StudioError for the setting `names[0]` or, with several names, for exactly these
    settings, which contradict each other."""
    with pytest.raises(StudioError) as caught:
        yield
    assert caught.value.code == "settings.invalid"
    found = caught.value.fields
    assert tuple(found.get("settings", (found["setting"].split(".")[0],))) == names, str(caught.value)
