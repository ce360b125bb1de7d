"""Assertions on the code and fields of an error instead of its text, and work that is canceled."""

import contextlib
import os
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from v3studio.studio.errors import Cancelled, StudioError

_UNSET: Any = object()


@contextlib.contextmanager
def refuses(
    code: str, *, file: str | os.PathLike[str] | None = _UNSET, value: Any = _UNSET, **fields: Any
) -> Iterator[pytest.ExceptionInfo[StudioError]]:
    """Assert that the block raises a StudioError with this code and, if given, this file, value and these fields."""
    with pytest.raises(StudioError) as caught:
        yield caught
    error = caught.value
    assert error.code == code, f"{error.code!r} instead of {code!r}: {error}"
    if file is not _UNSET:
        found = None if error.file is None else os.fspath(error.file)
        assert found == (None if file is None else os.fspath(file)), str(error)
    if value is not _UNSET:
        assert error.value == value, f"{error.value!r} instead of {value!r}: {error}"
    for name, expected in fields.items():
        assert error.fields.get(name) == expected, f"{name} = {error.fields.get(name)!r}: {error}"


def cancel_at(step: int) -> Callable[..., None]:
    """A progress function that raises Cancelled at the first step from this one on."""

    def progress(done: int, total: int, **figures: object) -> None:
        if done >= step:
            raise Cancelled

    return progress
