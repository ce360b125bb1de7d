"""Drawing splats: `rasterize`, with three backends that are held to one definition.

- `reference`: readable torch, any dtype; the definition (`reference.py`).
- `cpu`: C++ kernels, forward and backward, on all cores (`cpu.py`, `csrc/`).
- `cuda`: gsplat (`cuda.py`).
"""

from studio.rasterizer.cpu import set_kernel_threads
from studio.rasterizer.interface import available_backends, check_finite, preferred_device, rasterize
from studio.rasterizer.types import Render

__all__ = ["Render", "available_backends", "check_finite", "preferred_device", "rasterize", "set_kernel_threads"]
