"""The loss on coded values in Triton: compiled, chosen on a GPU, and, where there is one, run on it."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from studio.training import coded_loss
from studio.training.triton.coded import WARPS
from tests.studio.training.test_coded_loss import make
from tests.support.triton import compile_kernels, needs_triton


@needs_triton
def test_the_kernel_compiles_for_a_gpu(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TRITON_CACHE_DIR", str(tmp_path))
    from studio.training.triton import coded_kernels as triton_coded_kernels

    types = {**dict.fromkeys(("count", "channels", "seed"), "i32"), "owner": "*i32"}
    types |= dict.fromkeys(("bits_weight", "difference_weight"), "fp32")
    compile_kernels(triton_coded_kernels, types, {"coded_loss": WARPS}, 80)


@pytest.mark.parametrize("backends", [("reference", "triton"), ("reference", "cuda")])
def test_the_choice_on_a_gpu(backends: tuple[str, ...], monkeypatch: pytest.MonkeyPatch) -> None:
    """Tensors that say that they are on a GPU; only the choice is looked at."""
    chosen: list[str] = []

    class OnGpu(torch.Tensor):
        device = torch.device("cuda", 0)  # type: ignore[assignment]

    loss, now = make(torch.float32, 5, 1.0, (0.3, 0.2))
    monkeypatch.setattr(coded_loss, "kernels_for", lambda *_: None)
    monkeypatch.setattr(coded_loss, "available_backends", lambda: backends)
    monkeypatch.setattr(coded_loss, "coded_loss_triton", lambda *_: chosen.append("triton"))
    monkeypatch.setattr(loss, "forward_torch", lambda *_: chosen.append("torch"))
    loss(now.as_subclass(OnGpu), 3)
    assert chosen == ["triton" if "triton" in backends else "torch"]


@needs_triton
@pytest.mark.gpu
@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")
def test_parity_on_the_gpu() -> None:
    loss, now = make(torch.float32, 100_000, 2.0, (0.3, 0.2))
    exact, _ = make(torch.float64, 100_000, 2.0, (0.3, 0.2))
    exact.before, exact.steps = loss.before.double(), loss.steps.double()
    exact.entropy._previous, exact.entropy._steps = exact.before / exact.steps, exact.steps
    truth, _ = exact.forward_torch(leaf := now.double().requires_grad_(), 7)
    (true_gradient,) = torch.autograd.grad(truth, leaf)
    on_gpu, _ = make(torch.float32, 100_000, 2.0, (0.3, 0.2))
    on_gpu = on_gpu.cuda()
    on_gpu.before, on_gpu.steps = loss.before.cuda(), loss.steps.cuda()
    found = []
    for _ in range(2):
        here = now.cuda().requires_grad_()
        value, _ = on_gpu(here, 7)
        leaves = [here, on_gpu.entropy.mu, on_gpu.entropy.log_sigma]
        found.append([value.detach(), *torch.autograd.grad(value, leaves)])
    assert float(abs(found[0][0].double().cpu() - truth.detach())) <= 1e-5 * float(truth)
    assert (found[0][1].double().cpu() - true_gradient).norm() <= 2e-5 * true_gradient.norm()
    assert all(torch.equal(one, other) for one, other in zip(*found, strict=True))
