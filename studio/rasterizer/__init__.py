"""Differentiable splat rasterization: `rasterize` and, for several cameras, `rasterize_views`, with three backends, all
tested against the same definition.

- `reference`: plain PyTorch, any floating dtype. This is the definition (`reference.py`).
- `cpu`: multithreaded C++ kernels for the forward and backward passes (`cpu.py`, `csrc/`).
- `triton`: Triton kernels for NVIDIA GPUs (`triton_backend.py`).
"""

from v3studio.studio.rasterizer.cpu import set_kernel_threads
from v3studio.studio.rasterizer.interface import (
    available_backends,
    check_finite,
    preferred_device,
    rasterize,
    rasterize_views,
)
from v3studio.studio.rasterizer.types import Render

__all__ = [
    "Render",
    "available_backends",
    "check_finite",
    "preferred_device",
    "rasterize",
    "rasterize_views",
    "set_kernel_threads",
]
