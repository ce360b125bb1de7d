"""Which numbers of a splat the stream stores, in which order, and on what planes.

A *component* is one number a splat (x of the position, opacity, ...); a *plane* is a square luma picture with one byte
a splat. Positions have 16 bits and two planes, all else 8 bits and one plane (paper, "Quantization bits setting").
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
import torch

from studio.errors import StudioError
from studio.gaussians import Gaussians

_RGB = "rgb"


@dataclass(frozen=True)
class Component:
    """One number a splat.

    Attributes:
        name: as in the manifest and in file names: mean_x, sh_0_r, opacity, log_scale_0, quat_w, ...
        attribute: which QP holds for it: means, opacities, scales, quats or sh.
        bits: 16 or 8.
    """

    name: str
    attribute: str
    bits: int = 8

    @property
    def levels(self) -> int:
        """Largest code: 65535 or 255."""
        return (1 << self.bits) - 1


def components(sh_degree: int) -> tuple[Component, ...]:
    """All components of a stream, in the order of the manifest: 11 + 3 (degree + 1)^2 of them.

    Spherical harmonics are coefficient-major: sh_k_r, sh_k_g, sh_k_b for k = 0, 1, ...
    """
    result = [Component(f"mean_{axis}", "means", 16) for axis in "xyz"]
    for k in range((sh_degree + 1) ** 2):
        result += [Component(f"sh_{k}_{c}", "sh") for c in _RGB]
    result.append(Component("opacity", "opacities"))
    result += [Component(f"log_scale_{i}", "scales") for i in range(3)]
    result += [Component(f"quat_{c}", "quats") for c in "wxyz"]
    return tuple(result)


def plane_side(splats: int) -> int:
    """Side of the smallest square whose side is a multiple of 8 and that holds all splats."""
    side = 8
    while side * side < splats:
        side += 8
    return side


def to_plane(codes: np.ndarray, side: int) -> np.ndarray:
    """(N,) codes, row by row, onto a (side, side) plane; what is left over repeats the last code (cheap to encode)."""
    plane = np.empty(side * side, dtype=np.uint8)
    plane[: len(codes)] = codes
    plane[len(codes) :] = codes[-1]
    return plane.reshape(side, side)


def component_frames(frames: Iterable[Gaussians], order: np.ndarray | None = None) -> Iterator[np.ndarray]:
    """What is quantised, frame by frame of one group.

    Quaternions are normalised, their sign chosen (w >= 0 in the keyframe, then nearest to the frame before, since q and
    -q are the same rotation), so that they do not jump in time. Opacity is linear, scale logarithmic.

    Args:
        frames: the group's frames, all with the same number of splats and SH degree.
        order: (N,) permutation applied to each frame; None leaves them as they are.

    Yields:
        (C, N) float32, rows as `components(sh_degree)`.

    Raises:
        StudioError: a frame has another number of splats or SH degree, or a value that is not finite.
    """
    previous: torch.Tensor | None = None
    shape: tuple[int, int] | None = None
    for number, frame in enumerate(frames):
        frame = frame.detach().to(device="cpu", dtype=torch.float32)
        found = (len(frame), frame.sh_degree)
        if shape is None:
            shape = found
            if len(frame) == 0:
                raise StudioError("Baking: the keyframe has no splats; train it again before baking.")
        if found != shape:
            raise StudioError(
                f"Baking: frame {number} of the group has {found[0]} splats of SH degree {found[1]}, its keyframe "
                f"{shape[0]} of degree {shape[1]}; all frames of a group need the same."
            )
        for name, tensor in frame.items():
            if not torch.isfinite(tensor).all():
                raise StudioError(f"Baking: frame {number} of the group has a value in {name} that is not finite.")
        if order is not None:
            frame = frame[torch.from_numpy(order)]
        quats = torch.nn.functional.normalize(frame.quats, dim=-1)
        reference = quats[:, 0] if previous is None else (quats * previous).sum(dim=-1)
        quats = torch.where((reference < 0)[:, None], -quats, quats)
        previous = quats
        rows = (frame.means.T, frame.sh.flatten(1).T, frame.opacities[None], frame.log_scales.T, quats.T)
        yield torch.cat([row.float() for row in rows]).numpy()


def gaussians_from_components(values: np.ndarray, sh_degree: int) -> Gaussians:
    """Inverse of `component_frames` for one frame.

    Args:
        values: (C, N) float32.
        sh_degree: 0 to 3.

    Returns:
        N Gaussians, float32, CPU. Quaternions are as stored: close to unit length, not normalised again.
    """
    rows = torch.from_numpy(values)
    colours = 3 * (sh_degree + 1) ** 2
    means, sh, opacity, log_scales, quats = torch.split(rows, [3, colours, 1, 3, 4])
    return Gaussians(
        means=means.T.contiguous(),
        quats=quats.T.contiguous(),
        log_scales=log_scales.T.contiguous(),
        logit_opacities=torch.logit(opacity[0], eps=1e-6),
        sh=sh.T.reshape(rows.shape[1], -1, 3).contiguous(),
    )
