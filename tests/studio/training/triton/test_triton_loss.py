"""The photometric loss in Triton: compiled for GPUs, chosen on one, and, where there is one, run on it."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from studio.training import photometric
from studio.training.photometric import photometric_loss, photometric_loss_torch
from studio.training.triton.loss import WARPS
from tests.support.triton import compile_kernels, needs_triton


@needs_triton
def test_the_kernels_compile_for_a_gpu(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TRITON_CACHE_DIR", str(tmp_path))
    from studio.training.triton import loss_kernels as triton_loss_kernels

    types = {**dict.fromkeys(("width", "height", "count"), "i32"), **dict.fromkeys(("of_l1", "of_ssim"), "fp32")}
    names = ("blur_rows_of_moments", "compare", "blur_rows", "combine")
    compile_kernels(triton_loss_kernels, types, dict.fromkeys(names, WARPS), 80)


@pytest.mark.parametrize("backends", [("reference", "triton"), ("reference", "cuda")])
def test_the_choice_on_a_gpu(backends: tuple[str, ...], monkeypatch: pytest.MonkeyPatch) -> None:
    """Tensors that say that they are on a GPU; only the choice is looked at."""
    chosen: list[str] = []

    class OnGpu(torch.Tensor):
        device = torch.device("cuda", 0)  # type: ignore[assignment]

    monkeypatch.setattr(photometric, "available_backends", lambda: backends)
    monkeypatch.setattr(photometric, "photometric_loss_triton", lambda *_: chosen.append("triton"))
    monkeypatch.setattr(photometric, "photometric_loss_torch", lambda *_: chosen.append("torch"))
    image = torch.zeros(8, 9, 3).as_subclass(OnGpu)
    photometric_loss(image, image)
    assert chosen == ["triton" if "triton" in backends else "torch"]


@needs_triton
@pytest.mark.gpu
@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")
@pytest.mark.parametrize("size", [(1, 1), (135, 64), (1080, 1920)])
def test_parity_on_the_gpu(size: tuple[int, int]) -> None:
    generator = torch.Generator().manual_seed(1)
    target = torch.rand(*size, 3, generator=generator)
    image = target + 0.2 * torch.randn(target.shape, generator=generator)
    exact = image.double().requires_grad_()
    truth = photometric_loss_torch(exact, target.double())
    (true_gradient,) = torch.autograd.grad(truth, exact)
    found = []
    for _ in range(2):
        leaf = image.cuda().requires_grad_()
        loss = photometric_loss(leaf, target.cuda())
        (gradient,) = torch.autograd.grad(loss, leaf)
        found.append((loss.detach().cpu(), gradient.cpu()))
    torch.testing.assert_close(found[0][0].double(), truth.detach(), rtol=1e-5, atol=1e-6)
    assert (found[0][1] - true_gradient).norm() <= 2e-5 * true_gradient.norm()
    assert torch.equal(found[0][0], found[1][0])
    assert torch.equal(found[0][1], found[1][1])
