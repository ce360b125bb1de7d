"""Printed results fit a line, whatever their arrays hold."""

from dataclasses import fields, is_dataclass
from pathlib import Path

import numpy as np
import pytest
import torch

import v3studio
from studio.counts import short_repr

ROOT = Path(__file__).parents[2]


def test_arrays_print_as_types_and_shapes() -> None:
    splats = v3studio.Gaussians(*(torch.zeros(9000, *shape) for shape in ((3,), (4,), (3,), (), (1, 3))))
    mesh = v3studio.Mesh(np.zeros((70, 3)), np.zeros((90, 3), np.int32))
    assert "sh=float32[9000, 1, 3]" in repr(splats)
    assert repr(mesh) == "Mesh(vertices=float64[70, 3], faces=int32[90, 3])"
    result = v3studio.InitResult(mesh, *(np.zeros((9, 3)),) * 3, dict.fromkeys("abcdef", 0.1), np.zeros(9), [])
    text = repr(result)
    assert f"mesh={mesh!r}" in text
    assert "disagreement=<6 items>" in text
    assert "\n" not in text


def test_a_manifest_prints_as_a_line() -> None:
    with v3studio.StreamReader.open(ROOT / "docs/assets/sample.v3s") as reader:
        text = str(reader.manifest)
    assert "frame_count=30" in text
    assert len(text) < 1500


@pytest.mark.parametrize("name", [name for name in v3studio.__all__ if is_dataclass(getattr(v3studio, name))])
def test_every_public_result_with_arrays_prints_short(name: str) -> None:
    kind = getattr(v3studio, name)
    has_arrays = any(word in str(field.type) for field in fields(kind) for word in ("Tensor", "ndarray"))
    assert not has_arrays or kind.__repr__ in (short_repr, v3studio.Camera.__repr__)
