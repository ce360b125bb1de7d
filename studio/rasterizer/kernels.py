"""Decides which computations of training run in the C++ kernels, and which in their PyTorch definitions."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import torch
from torch import Tensor

from v3studio.studio.rasterizer.cpu import load_kernels
from v3studio.studio.rasterizer.interface import available_backends

_enabled = True


def kernels_for(*tensors: Tensor) -> Any | None:
    """The C++ kernels if they can compute with these tensors, on the CPU and all float32 or all float64, else None: on
    other devices, and where the kernels are not built, the PyTorch definition of each computation is used."""
    if not _enabled:
        return None
    dtype = tensors[0].dtype
    if dtype not in (torch.float32, torch.float64):
        return None
    if any(tensor.device.type != "cpu" or tensor.dtype != dtype for tensor in tensors):
        return None
    return load_kernels() if "cpu" in available_backends() else None


def uses_triton(tensor: Tensor) -> bool:
    """Return whether the Triton kernels of training compute with a tensor: float32 on an NVIDIA GPU, if Triton is
    there."""
    return tensor.device.type == "cuda" and tensor.dtype == torch.float32 and "triton" in available_backends()


@contextmanager
def definitions_only() -> Iterator[None]:
    """Let `kernels_for` give None within: for tests and measurements."""
    global _enabled
    before, _enabled = _enabled, False
    try:
        yield
    finally:
        _enabled = before
