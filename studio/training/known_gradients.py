"""Values whose gradients a kernel computes along with them."""

from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable


class _Known(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, value: Tensor, gradients: Sequence[Tensor | None], *_: Tensor) -> Tensor:
        ctx.save_for_backward(*gradients)
        return value

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, upstream: Tensor) -> tuple[Tensor | None, ...]:
        gradients: Sequence[Tensor | None] = ctx.saved_tensors
        # the number on a GPU would have to be waited for
        same = not upstream.dim() and upstream.device.type == "cpu" and float(upstream) == 1.0
        return None, None, *(gradient if gradient is None or same else gradient * upstream for gradient in gradients)


def with_gradients(value: Tensor, inputs: Sequence[Tensor], gradients: Sequence[Tensor | None]) -> Tensor:
    """`value`, differentiable with respect to `inputs`, whose gradients are these times what comes from upstream: of a
    scalar, or element by element. None: not known, for inputs that need none."""
    output: Tensor = _Known.apply(value, gradients, *inputs)
    return output
