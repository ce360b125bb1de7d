"""Adam (Kingma and Ba 2015) with PyTorch's fused kernel and without PyTorch's compiler."""

from collections.abc import Iterable
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.optim.adam import adam


@dataclass
class ParameterGroup:
    """Leaf tensors with the same learning rate; both may be changed between steps."""

    leaves: list[Tensor]
    rate: float
    name: str = ""


class Adam:
    """`torch.optim.Adam(..., fused=True)`, with the same results to the last bit.

    Constructing `torch.optim.Adam` imports PyTorch's compiler, which training does not use; that takes longer than
    importing PyTorch. This class calls the same function for a step.

    Args:
        betas: decay of the two moments per step.
        eps: added to the root of the second moment.

    Attributes:
        state: leaf to its `exp_avg`, `exp_avg_sq` and `step`; none before its first step.
    """

    def __init__(
        self, groups: Iterable[ParameterGroup], betas: tuple[float, float] = (0.9, 0.999), eps: float = 1e-8
    ) -> None:
        self.groups = list(groups)
        self.state: dict[Tensor, dict[str, Tensor]] = {}
        self._betas, self._eps = betas, eps

    @torch.no_grad()
    def step(self) -> None:
        """Take a step for each leaf that has a gradient."""
        for group in self.groups:
            leaves = [leaf for leaf in group.leaves if leaf.grad is not None]
            if not leaves:
                continue
            states = [self._state_of(leaf) for leaf in leaves]
            adam(
                leaves,
                [leaf.grad for leaf in leaves if leaf.grad is not None],
                [state["exp_avg"] for state in states],
                [state["exp_avg_sq"] for state in states],
                [],
                [state["step"] for state in states],
                fused=True,
                amsgrad=False,
                beta1=self._betas[0],
                beta2=self._betas[1],
                lr=group.rate,
                weight_decay=0.0,
                eps=self._eps,
                maximize=False,
            )

    def zero_grad(self) -> None:
        """Remove the gradients."""
        for group in self.groups:
            for leaf in group.leaves:
                leaf.grad = None

    def _state_of(self, leaf: Tensor) -> dict[str, Tensor]:
        state = self.state.get(leaf)
        if state is None:
            state = self.state[leaf] = {
                "step": torch.zeros((), dtype=torch.float32, device=leaf.device),
                "exp_avg": torch.zeros_like(leaf, memory_format=torch.preserve_format),
                "exp_avg_sq": torch.zeros_like(leaf, memory_format=torch.preserve_format),
            }
        return state
