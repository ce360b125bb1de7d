"""Printed results fit a line, whatever their arrays hold."""

from dataclasses import fields, is_dataclass

import pytest

import v3studio
from studio.counts import short_repr


@pytest.mark.parametrize("name", [name for name in v3studio.__all__ if is_dataclass(getattr(v3studio, name))])
def test_every_public_result_with_arrays_prints_short(name: str) -> None:
    kind = getattr(v3studio, name)
    has_arrays = any(word in str(field.type) for field in fields(kind) for word in ("Tensor", "ndarray"))
    assert not has_arrays or kind.__repr__ in (short_repr, v3studio.Camera.__repr__)
