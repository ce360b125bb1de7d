"""The Triton kernels of training: compiled for GPUs, chosen on one, and, where there is one, run on it."""

import importlib
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from types import SimpleNamespace

import pytest
import torch
from torch import Tensor

from tests.studio.training.test_coded_loss import in_double, make
from tests.studio.training.test_motion import field_and_means
from tests.support.triton import compile_kernels, needs_triton
from v3studio.studio.rasterizer import kernels
from v3studio.studio.training import photometric
from v3studio.studio.training.photometric import photometric_loss, photometric_loss_torch

TYPES: dict[str, dict[str, str]] = {
    "loss": {**dict.fromkeys(("width", "height", "count"), "i32"), **dict.fromkeys(("of_l1", "of_ssim"), "fp32")},
    "coded": {
        **dict.fromkeys(("count", "channels", "seed"), "i32"),
        **dict.fromkeys(("bits_weight", "difference_weight"), "fp32"),
        "owner": "*i32",
    },
}
"""Triton's types of the arguments that are not pointers to float32, by module."""
KERNELS = {
    "loss": ("blur_rows_of_moments", "compare", "blur_rows", "combine"),
    "coded": ("coded_loss",),
}


@needs_triton
@pytest.mark.parametrize("name", TYPES)
def test_the_kernels_compile_for_a_gpu(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TRITON_CACHE_DIR", str(tmp_path))
    module = importlib.import_module(f"v3studio.studio.training.triton.{name}")
    compile_kernels(module, TYPES[name], dict.fromkeys(KERNELS[name], module.WARPS), 80)


class OnGpu(torch.nn.Parameter):
    """Says that it is on a GPU, for tests that look only at the choice of the kernel."""

    device = torch.device("cuda", 0)  # type: ignore[assignment]


@pytest.mark.parametrize("backends", [("reference", "triton"), ("reference", "cuda")])
@pytest.mark.parametrize(
    ("name", "dtype"), [("loss", torch.float32), ("coded", torch.float32), ("coded", torch.float64)]
)
def test_the_choice_on_a_gpu(
    name: str, dtype: torch.dtype, backends: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    chosen = []
    by_triton, by_torch = (lambda *_, kernel=kernel: chosen.append(kernel) for kernel in ("triton", "torch"))
    functions = ("photometric_loss_triton", "coded_loss_triton")
    in_triton = SimpleNamespace(**dict.fromkeys(functions, by_triton))
    monkeypatch.setitem(sys.modules, f"v3studio.studio.training.triton.{name}", in_triton)
    monkeypatch.setattr(kernels, "available_backends", lambda: backends)
    if name == "loss":
        monkeypatch.setattr(photometric, "photometric_loss_torch", by_torch)
        image = torch.zeros(8, 9, 3).as_subclass(OnGpu)
        photometric_loss(image, image)
    else:
        coded_values, now = make(dtype, 5, 1.0, (0.3, 0.2))
        monkeypatch.setattr(coded_values, "forward_torch", by_torch)
        coded_values(now.as_subclass(OnGpu), 3)
    assert chosen == ["triton" if "triton" in backends and dtype == torch.float32 else "torch"]


def check_on_the_gpu(run: Callable[[], list[Tensor]], right: Sequence[Tensor]) -> None:
    """The first results are these in float64, and all have the same bits the next time."""
    found, again = run(), run()
    for value, expected in zip(found, right, strict=False):
        assert (value.double().cpu() - expected).norm() <= 2e-5 * expected.norm() + 1e-6
    assert all(torch.equal(one, other) for one, other in zip(found, again, strict=True))


@needs_triton
@pytest.mark.gpu
@pytest.mark.parametrize("size", [(1, 1), (135, 64), (1080, 1920)])
def test_the_loss_on_the_gpu(size: tuple[int, int]) -> None:
    generator = torch.Generator().manual_seed(1)
    target = torch.rand(*size, 3, generator=generator)
    image = target + 0.2 * torch.randn(target.shape, generator=generator)
    exact = image.double().requires_grad_()
    truth = photometric_loss_torch(exact, target.double())

    def run() -> list[Tensor]:
        value = photometric_loss(leaf := image.cuda().requires_grad_(), target.cuda())
        return [value.detach(), *torch.autograd.grad(value, leaf)]

    check_on_the_gpu(run, [truth.detach(), *torch.autograd.grad(truth, exact)])


@needs_triton
@pytest.mark.gpu
def test_the_loss_on_coded_values_on_the_gpu() -> None:
    reference, now = make(torch.float32, 100_000, 2.0, (0.3, 0.2))
    exact = in_double(reference)
    truth, _ = exact.forward_torch(leaf := now.double().requires_grad_(), 7)
    on_gpu, _ = make(torch.float32, 100_000, 2.0, (0.3, 0.2))
    on_gpu = on_gpu.cuda()
    on_gpu.before, on_gpu.steps = reference.before.cuda(), reference.steps.cuda()

    def run() -> list[Tensor]:
        value, _ = on_gpu(here := now.cuda().requires_grad_(), 7)
        leaves = [here, on_gpu.mu, on_gpu.log_sigma]
        return [value.detach(), *torch.autograd.grad(value, leaves)]

    check_on_the_gpu(run, [truth.detach(), *torch.autograd.grad(truth, leaf)])


@needs_triton
@pytest.mark.gpu
@pytest.mark.parametrize("sizes", [{}, {"levels": 3, "features": 3, "width": 130, "layers": 3}])
def test_the_motion_field_on_the_gpu(sizes: dict[str, int]) -> None:
    moving, means = field_and_means(torch.float32, 100_000, log2_size=15, **sizes)
    corners = moving.corners(means)
    exact, _ = field_and_means(torch.float64, 100_000, log2_size=15, **sizes)
    exact.load_state_dict({name: value.double() for name, value in moving.state_dict().items()})
    in_double = type(corners)(corners.rows, corners.weights.double(), corners.level_rows)
    sturdy = torch.ones(len(means), 1)  # 0 where float32 may have a neuron on the other side of its kink

    def mark_kinks(_: torch.nn.Module, inputs: tuple[Tensor, ...]) -> None:
        sturdy.mul_((inputs[0].abs() > 1e-5).all(1, keepdim=True))

    for layer in exact.mlp:
        if isinstance(layer, torch.nn.ReLU):
            layer.register_forward_pre_hook(mark_kinks)
    moved = exact.forward_torch(in_double)
    assert 0.9 < sturdy.mean() < 1
    upstream = sturdy * torch.randn(means.shape, generator=torch.Generator().manual_seed(1))
    right = [moved.detach(), *torch.autograd.grad(moved, list(exact.parameters()), upstream.double())]
    on_gpu = type(corners)(corners.rows.cuda(), corners.weights.cuda(), corners.level_rows)
    moving = moving.cuda()

    def run() -> list[Tensor]:
        here = moving(on_gpu)
        return [here.detach(), *torch.autograd.grad(here, list(moving.parameters()), upstream.cuda())]

    check_on_the_gpu(run, right)
