"""Gaussians: the splats of one frame, from training to display.

The stored values are those that are optimized; activations map them to the rendered values (3DGS, Kerbl et al. 2023,
section 5):
scale = exp(log_scales), opacity = sigmoid(logit_opacities), rotation = quats / |quats|. Quaternions are wxyz.
Color is spherical harmonics, coefficient-major: color = 0.5 + sum_k Y_k(direction) sh[:, k], clamped below at 0.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import torch
from torch import Tensor

from v3studio.studio.counts import short_repr
from v3studio.studio.dilation import DILATION, MAX_DILATION, MIN_DILATION
from v3studio.studio.errors import StudioError

SH_C0 = 0.28209479177387814
"""Y_0, the constant spherical harmonic 1 / (2 sqrt(pi)): color = 0.5 + SH_C0 * sh[:, 0] at degree 0."""

ATTRIBUTES = ("means", "quats", "log_scales", "logit_opacities", "sh")


@dataclass(eq=False)
class Gaussians:
    """N splats. All tensors share one device and one floating dtype.

    Attributes:
        means: (N, 3) world positions.
        quats: (N, 4) rotations as quaternions wxyz of any norm above 0.
        log_scales: (N, 3) natural logarithms of the standard deviations along the splat's axes, in world units.
        logit_opacities: (N,) logit of the opacity.
        sh: (N, K, 3) spherical harmonics, K = (degree + 1)^2, coefficient-major, RGB last.
        dilation: what is added to the diagonal of their 2D covariances when they are rendered, square pixels of that
            image, from `MIN_DILATION` to `MAX_DILATION`. They were trained with it and must be rendered with it.

    Raises:
        StudioError: a tensor has the wrong shape (gaussians.wrong_shape), the number of SH coefficients is not that
            of a degree from 0 to 3 (gaussians.sh_degree), or the dilation is out of bounds (gaussians.dilation).
    """

    means: Tensor
    quats: Tensor
    log_scales: Tensor
    logit_opacities: Tensor
    sh: Tensor
    dilation: float = DILATION

    __repr__ = short_repr

    def __post_init__(self) -> None:
        if not MIN_DILATION <= self.dilation <= MAX_DILATION:
            problem = (
                f"the dilation of the Gaussians is {self.dilation}; it must be from {MIN_DILATION} to {MAX_DILATION}"
            )
            raise StudioError("gaussians.dilation", problem, value=self.dilation, expected=[MIN_DILATION, MAX_DILATION])
        n = self.means.shape[0]
        expected = {
            "means": (n, 3),
            "quats": (n, 4),
            "log_scales": (n, 3),
            "logit_opacities": (n,),
            "sh": (n, self.sh.shape[1] if self.sh.ndim == 3 else -1, 3),
        }
        for name, shape in expected.items():
            own_shape = tuple(getattr(self, name).shape)
            if own_shape != shape:
                problem = f"{name} of the Gaussians has shape {own_shape}, expected {shape}"
                raise StudioError(
                    "gaussians.wrong_shape", problem, value=list(own_shape), attribute=name, expected=list(shape)
                )
        if self.sh.shape[1] not in (1, 4, 9, 16):
            problem = (
                f"found {self.sh.shape[1]} SH coefficients per color channel, expected 1, 4, 9 or 16 (degrees 0 to 3)"
            )
            raise StudioError("gaussians.sh_degree", problem, value=self.sh.shape[1], expected=[1, 4, 9, 16])

    def __len__(self) -> int:
        return self.means.shape[0]

    @property
    def sh_degree(self) -> int:
        """Degree of the spherical harmonics, 0 to 3."""
        return {1: 0, 4: 1, 9: 2, 16: 3}[self.sh.shape[1]]

    @property
    def device(self) -> torch.device:
        """Device of the tensors."""
        return self.means.device

    @property
    def scales(self) -> Tensor:
        """(N, 3): standard deviations along the splat's axes, in world units."""
        return self.log_scales.exp()

    @property
    def opacities(self) -> Tensor:
        """(N,): opacities, 0 to 1."""
        return self.logit_opacities.sigmoid()

    @property
    def unit_quats(self) -> Tensor:
        """(N, 4): unit quaternions wxyz."""
        return torch.nn.functional.normalize(self.quats, dim=-1)

    def items(self) -> Iterator[tuple[str, Tensor]]:
        """(name, tensor) in the fixed order of `ATTRIBUTES`."""
        for name in ATTRIBUTES:
            yield name, getattr(self, name)

    def on_cpu(self) -> dict[str, Tensor]:
        """Attribute name to tensor, in the order of `ATTRIBUTES`, detached, contiguous and on the CPU."""
        return {name: tensor.detach().cpu().contiguous() for name, tensor in self.items()}

    def state_dict(self) -> dict[str, Tensor]:
        """The tensors that safetensors stores: `on_cpu`, and a dilation other than `DILATION` as a float64 scalar,
        `dilation`."""
        state = self.on_cpu()
        if self.dilation != DILATION:
            state["dilation"] = torch.tensor(self.dilation, dtype=torch.float64)
        return state

    @classmethod
    def from_state_dict(cls, tensors: dict[str, Tensor]) -> Gaussians:
        """Inverse of `state_dict`; other keys are ignored. StudioError if an attribute is missing
        (gaussians.missing_attribute) or has the wrong shape, or the dilation is not one number or out of bounds."""
        missing = [name for name in ATTRIBUTES if name not in tensors]
        if missing:
            problem = f"these attributes of the Gaussians are missing: {', '.join(missing)}"
            raise StudioError("gaussians.missing_attribute", problem, value=missing, expected=list(ATTRIBUTES))
        stored = tensors.get("dilation")
        dilation = DILATION if stored is None else float(stored) if stored.numel() == 1 else math.nan
        return cls(**{name: tensors[name] for name in ATTRIBUTES}, dilation=dilation)

    def map(self, function: Any) -> Gaussians:
        """New Gaussians with `function` applied to each tensor, and the same dilation."""
        return replace(self, **{name: function(tensor) for name, tensor in self.items()})

    def __getitem__(self, index: Any) -> Gaussians:
        """The splats selected by an index, a slice, an index tensor or a boolean mask, always as Gaussians."""
        if isinstance(index, int):
            index = slice(index, index + 1 if index != -1 else None)
        return self.map(lambda tensor: tensor[index])

    def to(self, *args: Any, **kwargs: Any) -> Gaussians:
        """`Tensor.to` for all attributes."""
        return self.map(lambda tensor: tensor.to(*args, **kwargs))

    def detach(self) -> Gaussians:
        """Return the splats detached from the autograd graph; they share memory."""
        return self.map(Tensor.detach)

    def clone(self) -> Gaussians:
        """A detached copy."""
        return self.map(lambda tensor: tensor.detach().clone())

    def with_sh_degree(self, degree: int) -> Gaussians:
        """Return the splats with another SH degree, 0 to 3: coefficients are dropped or filled with zeros."""
        wanted = (degree + 1) ** 2
        have = self.sh.shape[1]
        if wanted <= have:
            sh = self.sh[:, :wanted]
        else:
            sh = torch.cat([self.sh, self.sh.new_zeros(len(self), wanted - have, 3)], dim=1)
        return replace(self, sh=sh)

    @classmethod
    def cat(cls, *parts: Gaussians) -> Gaussians:
        """The splats of all parts, in order; StudioError if their dilation differs (`gaussians.dilations_differ`)."""
        dilation, *others = sorted({part.dilation for part in parts})
        if others:
            values = " and ".join(f"{dilation_:g}" for dilation_ in (dilation, *others))
            problem = f"splats that are rendered together have dilations of {values} square pixels; one image has one"
            fix = "Train them with the same train.dilation"
            raise StudioError("gaussians.dilations_differ", problem, value=[dilation, *others], fix=fix)
        return cls(**{name: torch.cat([getattr(p, name) for p in parts]) for name in ATTRIBUTES}, dilation=dilation)

    def before(self, others: Gaussians | None) -> Gaussians:
        """Return the splats together with those of a set, if any, which are rendered with the dilation of these."""
        if others is None:
            return self
        degree = max(self.sh_degree, others.sh_degree)
        behind = replace(others, dilation=self.dilation).to(self.means)
        return Gaussians.cat(self.with_sh_degree(degree), behind.with_sh_degree(degree))

    @classmethod
    def from_activated(cls, means: Tensor, quats: Tensor, scales: Tensor, opacities: Tensor, sh: Tensor) -> Gaussians:
        """Make splats from linear scales and opacities, clamped to at least 1e-12, and to 1e-6 from 0 and 1."""
        return cls(
            means=means,
            quats=quats,
            log_scales=scales.clamp_min(1e-12).log(),
            logit_opacities=torch.logit(opacities, eps=1e-6),
            sh=sh,
        )
