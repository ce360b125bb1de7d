"""Gaussians: the splats of one frame. The same object travels from training to the viewport.

Stored values are what is optimized; activations turn them into what is drawn (3DGS, Kerbl et al. 2023, section 5):
scale = exp(log_scales), opacity = sigmoid(logit_opacities), rotation = quats / |quats|. Quaternions are wxyz.
Color is spherical harmonics, coefficient-major: color = 0.5 + sum_k Y_k(direction) sh[:, k], clamped below at 0.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields
from typing import Any

import torch
from torch import Tensor

from studio.errors import StudioError

SH_C0 = 0.28209479177387814
"""Y_0, the constant spherical harmonic 1 / (2 sqrt(pi)): color = 0.5 + SH_C0 * sh[:, 0] at degree 0."""

ATTRIBUTES = ("means", "quats", "log_scales", "logit_opacities", "sh")


@dataclass(eq=False)
class Gaussians:
    """N splats. All tensors share a device and a floating dtype.

    Attributes:
        means: (N, 3) world positions.
        quats: (N, 4) rotations, wxyz, of any length above 0.
        log_scales: (N, 3) natural logarithm of the standard deviations along the splat's own axes, world units.
        logit_opacities: (N,) logit of the opacity.
        sh: (N, K, 3) spherical harmonics, K = (degree + 1)^2, coefficient-major, RGB last.

    Raises:
        StudioError: shapes do not fit together.
    """

    means: Tensor
    quats: Tensor
    log_scales: Tensor
    logit_opacities: Tensor
    sh: Tensor

    def __post_init__(self) -> None:
        n = self.means.shape[0]
        expected = {
            "means": (n, 3),
            "quats": (n, 4),
            "log_scales": (n, 3),
            "logit_opacities": (n,),
            "sh": (n, self.sh.shape[1] if self.sh.ndim == 3 else -1, 3),
        }
        for name, shape in expected.items():
            found = tuple(getattr(self, name).shape)
            if found != shape:
                raise StudioError(f"Gaussians: {name} has the shape {found}, expected {shape}.")
        if self.sh.shape[1] not in (1, 4, 9, 16):
            raise StudioError(
                f"Gaussians: {self.sh.shape[1]} SH coefficients a color given; degrees 0 to 3 have 1, 4, 9 or 16."
            )

    def __len__(self) -> int:
        return self.means.shape[0]

    @property
    def sh_degree(self) -> int:
        """0 to 3."""
        return {1: 0, 4: 1, 9: 2, 16: 3}[self.sh.shape[1]]

    @property
    def device(self) -> torch.device:
        """Where all tensors live."""
        return self.means.device

    @property
    def scales(self) -> Tensor:
        """(N, 3): standard deviations, world units."""
        return self.log_scales.exp()

    @property
    def opacities(self) -> Tensor:
        """(N,): in 0 to 1."""
        return self.logit_opacities.sigmoid()

    @property
    def unit_quats(self) -> Tensor:
        """(N, 4): wxyz, length 1."""
        return torch.nn.functional.normalize(self.quats, dim=-1)

    def items(self) -> Iterator[tuple[str, Tensor]]:
        """(name, tensor) in the fixed order of `ATTRIBUTES`."""
        for field_ in fields(self):
            yield field_.name, getattr(self, field_.name)

    def state_dict(self) -> dict[str, Tensor]:
        """Name to tensor, detached, contiguous, on the CPU: what safetensors stores."""
        return {name: tensor.detach().cpu().contiguous() for name, tensor in self.items()}

    @classmethod
    def from_state_dict(cls, tensors: dict[str, Tensor]) -> Gaussians:
        """Inverse of `state_dict`; other keys are ignored.

        Raises:
            StudioError: an attribute is missing or its shape is wrong.
        """
        missing = [name for name in ATTRIBUTES if name not in tensors]
        if missing:
            raise StudioError(f"Gaussians: the attributes {', '.join(missing)} are missing.")
        return cls(**{name: tensors[name] for name in ATTRIBUTES})

    def map(self, function: Any) -> Gaussians:
        """A new Gaussians with `function` applied to each tensor."""
        return Gaussians(**{name: function(tensor) for name, tensor in self.items()})

    def __getitem__(self, index: Any) -> Gaussians:
        """Splats selected by a slice, an index tensor or a boolean mask."""
        if isinstance(index, int):
            index = slice(index, index + 1 if index != -1 else None)
        return self.map(lambda tensor: tensor[index])

    def to(self, *args: Any, **kwargs: Any) -> Gaussians:
        """As `Tensor.to`, for all attributes."""
        return self.map(lambda tensor: tensor.to(*args, **kwargs))

    def detach(self) -> Gaussians:
        """Cut from the autograd graph; shares memory."""
        return self.map(Tensor.detach)

    def clone(self) -> Gaussians:
        """Detached copies."""
        return self.map(lambda tensor: tensor.detach().clone())

    def with_sh_degree(self, degree: int) -> Gaussians:
        """The same splats at another SH degree: higher coefficients are cut off or filled with zeros."""
        wanted = (degree + 1) ** 2
        have = self.sh.shape[1]
        if wanted <= have:
            sh = self.sh[:, :wanted]
        else:
            sh = torch.cat([self.sh, self.sh.new_zeros(len(self), wanted - have, 3)], dim=1)
        return Gaussians(self.means, self.quats, self.log_scales, self.logit_opacities, sh)

    @classmethod
    def cat(cls, *parts: Gaussians) -> Gaussians:
        """All splats of the parts, in order."""
        return cls(**{name: torch.cat([getattr(p, name) for p in parts]) for name in ATTRIBUTES})

    @classmethod
    def from_activated(cls, means: Tensor, quats: Tensor, scales: Tensor, opacities: Tensor, sh: Tensor) -> Gaussians:
        """From linear scales (> 0) and opacities in 0 to 1 (both clamped just inside their range)."""
        return cls(
            means=means,
            quats=quats,
            log_scales=scales.clamp_min(1e-12).log(),
            logit_opacities=torch.logit(opacities, eps=1e-6),
            sh=sh,
        )
