"""Which numbers of a splat the stream stores, in which order, and how they are laid out in pictures.

A *component* is one number per splat (x of the mean, opacity, ...); a *plane* is a square luma picture with one byte
per splat. Means have 16 bits and two planes, all else 8 bits and one plane (paper, "Quantization bits setting").
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
import torch

from studio.errors import StudioError
from studio.gaussians import Gaussians

_RGB = "rgb"
_SHORTEST_QUAT = 1e-6


@dataclass(frozen=True)
class Component:
    """One number per splat.

    Attributes:
        name: as in the manifest and in file names: mean_x, sh_0_r, opacity, log_scale_0, quat_w, ...
        attribute: the attribute whose QP applies: means, opacities, scales, quats or sh.
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
    """All 11 + 3 (degree + 1)^2 components, in the order of the manifest.

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
    """Side of a plane in pixels: the smallest multiple of 8 whose square is at least `splats`."""
    side = 8
    while side * side < splats:
        side += 8
    return side


def channels(sh_degree: int) -> tuple[str, ...]:
    """All 10 + 3 (degree + 1)^2 channels of the profile `motion`, in the order of the manifest."""
    result = [f"residual_{axis}" for axis in "xyz"]
    result += [f"rotation_{i}" for i in range(3)]
    result += [f"log_scale_{i}" for i in range(3)]
    result.append("opacity")
    for k in range((sh_degree + 1) ** 2):
        result += [f"sh_{k}_{part}" for part in ("y", "co", "cg")]
    return tuple(result)


def tile_side(splats: int) -> int:
    """Side of a tile in pixels: the smallest multiple of 16, the codec's block, whose square is at least `splats`."""
    side = 16
    while side * side < splats:
        side += 16
    return side


def tile_grid(tiles: int) -> tuple[int, int]:
    """Columns and rows of the picture: as few empty tiles as possible, then as square as possible."""

    def badness(columns: int) -> tuple[int, int]:
        rows = -(-tiles // columns)
        return 2 * (columns * rows - tiles) + abs(columns - rows), columns

    columns = min(range(1, tiles + 1), key=badness)
    return columns, -(-tiles // columns)


def to_plane(codes: np.ndarray, side: int) -> np.ndarray:
    """(N,) codes, row by row, as a (side, side) plane. The rest repeats the last code, which is cheap to encode."""
    plane = np.empty(side * side, dtype=np.uint8)
    plane[: len(codes)] = codes
    plane[len(codes) :] = codes[-1]
    return plane.reshape(side, side)


def component_frames(frames: Iterable[Gaussians], order: np.ndarray | None = None) -> Iterator[np.ndarray]:
    """The values to quantize, per frame of one group.

    Quaternions are normalized and have the sign w >= 0 in the keyframe, then the sign nearest to the previous frame
    (q and -q are the same rotation), so that they are continuous in time. Opacity is linear, scale logarithmic.

    Args:
        frames: frames of the group, with the same number of splats and SH degree.
        order: (N,) permutation of the splats; None keeps their order.

    Yields:
        (C, N) float32, rows as `components(sh_degree)`.

    Raises:
        StudioError: the keyframe is empty, a frame differs in its number of splats, SH degree or dilation, or a value
            is not finite.
    """
    # NumPy instead of torch: the operations are small, and torch's thread pool costs more than they do.
    previous: np.ndarray | None = None
    first: Gaussians | None = None
    shape: tuple[int, int] | None = None
    for number, frame in enumerate(frames):
        found = (len(frame), frame.sh_degree)
        first = frame if first is None else first
        if shape is None:
            shape = found
            if len(frame) == 0:
                raise StudioError("bake.no_splats", "the keyframe has no splats", fix="Train the group again.")
        if found != shape:
            raise StudioError(
                "bake.mixed_frames",
                f"frame {number} of the group has {found[0]} splats of SH degree {found[1]}, but its keyframe has "
                f"{shape[0]} of degree {shape[1]}",
                value=found,
                fix="Train the group again, or split it.",
                frame=number,
                expected=shape,
            )
        if frame.dilation != first.dilation:
            raise StudioError(
                "bake.mixed_dilations",
                f"frame {number} of the group is drawn with a dilation of {frame.dilation:g} square pixels, but its "
                f"keyframe with {first.dilation:g}",
                value=frame.dilation,
                fix="Train the group again.",
                frame=number,
                expected=first.dilation,
            )
        arrays = {name: tensor.numpy().astype(np.float32, copy=False) for name, tensor in frame.on_cpu().items()}
        for name, array in arrays.items():
            if not np.isfinite(array).all():
                raise StudioError(
                    "gaussians.not_finite",
                    f"frame {number} of the group has a value in {name} that is not finite",
                    fix="Train the group again.",
                    frame=number,
                    attribute=name,
                )
        values = np.concatenate(
            [
                arrays["means"].T,
                arrays["sh"].reshape(len(frame), -1).T,
                _sigmoid(arrays["logit_opacities"])[None],
                arrays["log_scales"].T,
                arrays["quats"].T,
            ]
        )
        if order is not None:
            values = np.take(values, order, axis=1)
        quats = values[-4:]
        quats /= np.maximum(np.linalg.norm(quats, axis=0), 1e-12)
        likeness = quats[0] if previous is None else (quats * previous).sum(axis=0)
        quats *= np.where(likeness < 0, np.float32(-1), np.float32(1))
        previous = quats.copy()
        yield values


def typical_size(log_scales: np.ndarray, extent: float) -> float:
    """Typical size of a splat, world units: the exponential of the median over splats of the mean of (3, N) log scales.

    At least extent / 65535, the finest step of the means, and above 0.
    """
    return max(float(np.exp(np.median(log_scales.mean(axis=0)))), extent / 65535, 1e-9)


def scale_floor(typical: float) -> float:
    """Lower bound of log scales: a sixteenth of the typical size, below which no difference is visible. Without it, one
    splat of scale 1e-12 would take most of the 256 levels."""
    return math.log(typical / 16)


def _sigmoid(values: np.ndarray) -> np.ndarray:
    with np.errstate(over="ignore"):  # exp overflows to inf and the result is 0, as intended
        return 1 / (1 + np.exp(-values))


class ComponentArrays:
    """Buffers for the components of one frame, in the memory layout of `Gaussians`.

    Attributes:
        rows: (N,) float32 view per component, in the order of `components(sh_degree)`, to be filled in.
    """

    def __init__(self, splats: int, sh_degree: int) -> None:
        self._means = np.empty((splats, 3), dtype=np.float32)
        self._sh = np.empty((splats, (sh_degree + 1) ** 2, 3), dtype=np.float32)
        self._opacities = np.empty(splats, dtype=np.float32)
        self._log_scales = np.empty((splats, 3), dtype=np.float32)
        self._quats = np.empty((splats, 4), dtype=np.float32)
        colors = self._sh.reshape(splats, -1)
        self.rows: list[np.ndarray] = [
            *self._means.T,
            *colors.T,
            self._opacities,
            *self._log_scales.T,
            *self._quats.T,
        ]

    def gaussians(self, dilation: float) -> Gaussians:
        """Gaussians that share the memory. Quaternions are as stored: close to unit length, not normalized.

        One that is too short to tell a rotation, which no baker writes, becomes the identity; its splat is not seen.
        """
        opacities = np.clip(self._opacities, 1e-6, 1 - 1e-6)
        none = np.einsum("ni,ni->n", self._quats, self._quats) < _SHORTEST_QUAT**2
        if none.any():
            self._quats[none] = (1, 0, 0, 0)
            opacities[none] = 1e-6
        return Gaussians(
            means=torch.from_numpy(self._means),
            quats=torch.from_numpy(self._quats),
            log_scales=torch.from_numpy(self._log_scales),
            logit_opacities=torch.from_numpy(np.log(opacities / (1 - opacities))),
            sh=torch.from_numpy(self._sh),
            dilation=dilation,
        )
