"""The motion field in Triton: compiled, chosen on a GPU, and, where there is one, run on it."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from studio.training import motion
from studio.training.hashgrid import PIECE, pieces_of
from studio.training.triton.field import WARPS, _columns
from tests.studio.training.test_motion import field_and_means
from tests.support.triton import compile_kernels, needs_triton


@needs_triton
def test_the_kernels_compile_for_a_gpu(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TRITON_CACHE_DIR", str(tmp_path))
    from studio.training.triton import field_kernels as triton_field_kernels

    numbers = ("count", "length", "features", "columns", "reads", "gives", "pieces", "total")
    numbers += ("input_columns", "out_columns", "slope_columns")
    types = {
        **dict.fromkeys(numbers, "i32"),
        **dict.fromkeys(("rows", "tiles", "readers"), "*i32"),
        **dict.fromkeys(("begins", "ends"), "*i64"),
    }
    names = ("encode", "layer_forward", "layer_backward", "parameter_gradient", "sum_pieces")
    widths = sorted({_columns(width) for width in range(1, 1025)})
    assert widths == [16, 32, 64]
    variants = {
        "layer_forward": [{"OUTPUTS": width, "LAST": last} for width, last in ((16, True), (64, False))],
        "layer_backward": [{"INPUTS": width, "FIRST": first} for width, first in ((16, True), (64, False))],
        "sum_pieces": [{"FEATURES": 4, "FIRST": first} for first in (True, False)],
    }
    compile_kernels(triton_field_kernels, types, dict.fromkeys(names, WARPS), 80, variants)


@pytest.mark.parametrize(
    "counts", [[0], [1, 0, 0, PIECE], [PIECE + 1, 3], [5 * PIECE**2 + 7, 0, PIECE, 1], [PIECE**2, PIECE**3 + 1]]
)
def test_pieces_add_each_number_once(counts: list[int]) -> None:
    values = torch.rand(sum(counts), generator=torch.Generator().manual_seed(4), dtype=torch.float64)
    expected = torch.stack([part.sum() for part in values.split(counts)])
    passes = pieces_of(torch.tensor(counts))
    for begins, ends in passes:
        assert int((ends - begins).max()) <= PIECE
        summed = torch.cat([values.new_zeros(1), values.cumsum(0)])
        values = summed[ends] - summed[begins]
    torch.testing.assert_close(values, expected, rtol=1e-9, atol=1e-9)
    assert len(passes) == next(n for n in range(1, 9) if PIECE**n >= max(counts)), "no more passes than needed"


@pytest.mark.parametrize("backends", [("reference", "triton"), ("reference", "cuda")])
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_the_choice_on_a_gpu(backends: tuple[str, ...], dtype: torch.dtype, monkeypatch: pytest.MonkeyPatch) -> None:
    """A table that says that it is on a GPU; only the choice is looked at."""
    chosen: list[str] = []

    class OnGpu(torch.nn.Parameter):
        device = torch.device("cuda", 0)  # type: ignore[assignment]

    field, means = field_and_means(dtype, 5, levels=2)
    corners = field.corners(means)
    field.grid.table = OnGpu(field.grid.table.detach())
    monkeypatch.setattr(motion, "kernels_for", lambda *_: None)
    monkeypatch.setattr(motion, "available_backends", lambda: backends)
    monkeypatch.setattr(motion, "motion_field_triton", lambda *_: chosen.append("triton"))
    monkeypatch.setattr(field, "forward_torch", lambda *_: chosen.append("torch"))
    field(corners)
    assert chosen == ["triton" if "triton" in backends and dtype == torch.float32 else "torch"]


@needs_triton
@pytest.mark.gpu
@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")
@pytest.mark.parametrize("sizes", [{}, {"levels": 3, "features": 3, "width": 130, "layers": 3}])
def test_parity_on_the_gpu(sizes: dict[str, int]) -> None:
    field, means = field_and_means(torch.float32, 100_000, log2_size=15, **sizes)
    upstream = torch.randn(means.shape, generator=torch.Generator().manual_seed(1))
    corners = field.corners(means)
    exact, _ = field_and_means(torch.float64, 100_000, log2_size=15, **sizes)
    exact.load_state_dict({name: value.double() for name, value in field.state_dict().items()})
    in_double = type(corners)(corners.rows, corners.weights.double(), corners.level_rows)
    moved = exact.forward_torch(in_double)
    right = [moved.detach(), *torch.autograd.grad(moved, list(exact.parameters()), upstream.double())]
    on_gpu = type(corners)(corners.rows.cuda(), corners.weights.cuda(), corners.level_rows)
    field = field.cuda()
    found = []
    for _ in range(2):
        moved = field(on_gpu)
        found.append([moved.detach(), *torch.autograd.grad(moved, list(field.parameters()), upstream.cuda())])
    for value, expected in zip(found[0], right, strict=True):
        assert (value.double().cpu() - expected).norm() <= 2e-5 * expected.norm()
    assert all(torch.equal(one, other) for one, other in zip(*found, strict=True))
