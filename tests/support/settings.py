"""Assertions on the setting that a model rejects."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

import pytest
from pydantic import ValidationError

from studio.settings import Conflict


@contextlib.contextmanager
def refuses_setting(*names: str) -> Iterator[None]:
    """Assert that the block raises one ValidationError for the field `names[0]` or, with several names, a `Conflict`
    of exactly these fields."""
    with pytest.raises(ValidationError) as caught:
        yield
    (problem,) = caught.value.errors()
    cause = problem.get("ctx", {}).get("error")
    if isinstance(cause, Conflict) and cause.names:
        assert cause.names == names, str(cause)
    else:
        assert (str(problem["loc"][0]),) == names, problem["msg"]
