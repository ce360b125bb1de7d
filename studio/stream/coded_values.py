"""The values that the paper codes: each number of a splat in 8 bits over its range (paper, "Quantization").

The losses that make them cheap to code (section 4.2) act on these; the stream's own channels are similar enough.
"""

import math
from typing import Any

import torch
from torch import Tensor

from v3studio.studio.gaussians import Gaussians
from v3studio.studio.rasterizer.cpu import kernel_threads
from v3studio.studio.rasterizer.kernels import kernels_for
from v3studio.studio.stream.attributes import BY_NAME
from v3studio.studio.stream.layout import plane_side

LEVELS = 255
_MIN_STEP = 1e-3

_TERMS = {"quats": "rotation", "scales": "scale", "opacities": "opacity", "sh": "color"}


def _columns(sh_degree: int) -> dict[str, slice]:
    """Columns of each term of the losses (paper, section 4.2), which count the first coefficient of SH as color."""
    columns, start = {}, 0
    for name, term in _TERMS.items():
        count = math.prod(BY_NAME[name].tensor_shape(1, 0))
        columns[term] = slice(start, start + count)
        start += count
    if sh_degree > 0:
        columns["sh"] = slice(start, start + 3 * ((sh_degree + 1) ** 2 - 1))
    return columns


class _Fused(torch.autograd.Function):
    """`CodedValues.coded_values` and its gradient, each in one pass."""

    @staticmethod
    def forward(
        ctx: Any, kernels: Any, reference: Tensor, quats: Tensor, log_scales: Tensor, logits: Tensor, sh: Tensor
    ) -> Tensor:
        inputs = [tensor.detach().contiguous() for tensor in (quats, log_scales, logits, sh, reference)]
        values = quats.new_empty((len(quats), 8 + 3 * sh.shape[1]))
        kernels.planes_values(*inputs, values, kernel_threads())
        ctx.kernels = kernels
        ctx.save_for_backward(*inputs, values)
        return values

    @staticmethod
    def backward(ctx: Any, *upstream: Tensor) -> tuple[Tensor | None, ...]:
        *inputs, values = ctx.saved_tensors
        gradients = [torch.empty_like(tensor) for tensor in inputs[:4]]
        ctx.kernels.planes_gradients(*inputs, values, upstream[0].contiguous(), *gradients, kernel_threads())
        return None, None, *gradients


class CodedValues:
    """The values that are coded for one frame's N splats, given the `previous` frame of the same group: unit
    quaternions with continuous sign, log scales, opacities and SH, each cut into 256 levels. Means are left out: the
    losses that use this act on the other attributes only (paper, section 4.2)."""

    def __init__(self, previous: Gaussians) -> None:
        self.attributes = _columns(previous.sh_degree)  # columns of each attribute in `coded_values`
        # area of the image that holds one channel, W x H of the paper's equation 12
        self.pixels = plane_side(len(previous)) ** 2
        self._quats = previous.unit_quats

    def coded_values(self, gaussians: Gaussians) -> Tensor:
        """(N, C) values that are quantized, differentiable; the splats must be in the order of the previous frame. Each
        quaternion has the sign that is nearer to the previous frame (q and -q are the same rotation)."""
        leaves = (gaussians.quats, gaussians.log_scales, gaussians.logit_opacities, gaussians.sh)
        kernels = kernels_for(*leaves, self._quats)
        if kernels is not None:
            return _Fused.apply(kernels, self._quats, *leaves)  # type: ignore[no-untyped-call,no-any-return]
        return self.coded_values_torch(gaussians)

    def coded_values_torch(self, gaussians: Gaussians) -> Tensor:
        """`coded_values` in plain PyTorch, for any device and dtype. This is the definition."""
        quats = gaussians.unit_quats
        sign = torch.where((quats.detach() * self._quats).sum(-1, keepdim=True) < 0, -1.0, 1.0)
        return torch.cat(
            [quats * sign, gaussians.log_scales, gaussians.opacities[:, None], gaussians.sh.flatten(1)], dim=1
        )

    def steps(self, values: Tensor) -> Tensor:
        """Step of each channel, (C,), from (N, C) coded values; at least 1e-3: a channel that is nearly constant in
        this frame has a larger range over the group, which the baker measures, but which training does not know."""
        return ((values.amax(0) - values.amin(0)) / LEVELS).clamp_min(_MIN_STEP).detach()
