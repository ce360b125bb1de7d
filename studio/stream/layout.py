"""Sizes of the images that hold the numbers of splats, and these numbers, taken from `Gaussians`."""

import math
from collections.abc import Iterable, Iterator

import numpy as np

from v3studio.studio.errors import StudioError
from v3studio.studio.gaussians import Gaussians
from v3studio.studio.stream.attributes import BY_NAME, component_rows


def plane_side(splats: int) -> int:
    """Side in pixels of the paper's square images, with a splat per pixel: a multiple of 8."""
    return 8 * math.ceil(math.sqrt(splats) / 8)


def tile_side(splats: int) -> int:
    """Side of a tile in pixels: the smallest multiple of 16, the codec's block, whose square is at least `splats`."""
    return 16 * math.ceil(math.sqrt(splats) / 16)


def tile_grid(tiles: int) -> tuple[int, int]:
    """Columns and rows of the image: as few empty tiles as possible, then as square as possible."""

    def badness(columns: int) -> tuple[int, int]:
        rows = -(-tiles // columns)
        return 2 * (columns * rows - tiles) + abs(columns - rows), columns

    columns = min(range(1, tiles + 1), key=badness)
    return columns, -(-tiles // columns)


def component_frames(frames: Iterable[Gaussians], order: np.ndarray | None = None) -> Iterator[np.ndarray]:
    """The values to quantize, (C, N) float32 with the rows of `attributes.component_rows`, per frame of one group.

    Quaternions are normalized and have the sign w >= 0 in the keyframe, then the sign nearest to the previous frame (q
    and -q are the same rotation), so that they are continuous in time. Opacity is linear, scale logarithmic. `order`,
    (N,), is a permutation of the splats. StudioError if the keyframe is empty, a frame differs in its number of splats,
    SH degree or dilation, or a value is not finite.
    """
    # NumPy instead of torch: the operations are small, and torch's thread pool costs more than they do.
    previous: np.ndarray | None = None
    first: Gaussians | None = None
    shape: tuple[int, int] | None = None
    for number, frame in enumerate(frames):
        own_shape = (len(frame), frame.sh_degree)
        first = frame if first is None else first
        if shape is None:
            shape = own_shape
            if len(frame) == 0:
                raise StudioError("bake.no_splats", "the keyframe has no splats", fix="Train the group again.")
        if own_shape != shape:
            problem = (
                f"frame {number} of the group has {own_shape[0]} splats of SH degree {own_shape[1]}, but its keyframe "
                f"has {shape[0]} of degree {shape[1]}"
            )
            fix = "Train the group again, or split it."
            raise StudioError("bake.mixed_frames", problem, value=own_shape, fix=fix, frame=number, expected=shape)
        if frame.dilation != first.dilation:
            problem = (
                f"frame {number} of the group has a dilation of {frame.dilation:g} square pixels, but its "
                f"keyframe {first.dilation:g}"
            )
            fix = "Train the group again."
            raise StudioError(
                "bake.mixed_dilations", problem, value=frame.dilation, fix=fix, frame=number, expected=first.dilation
            )
        arrays = {name: tensor.numpy().astype(np.float32, copy=False) for name, tensor in frame.on_cpu().items()}
        for name, array in arrays.items():
            if not np.isfinite(array).all():
                problem = f"frame {number} of the group has a value in {name} that is not finite"
                fix = "Train the group again."
                raise StudioError("gaussians.not_finite", problem, fix=fix, frame=number, attribute=name)
        rows = component_rows(frame.sh_degree)
        columns = (BY_NAME[name].activate(arrays[BY_NAME[name].tensor]) for name in rows)
        values = np.concatenate([column.reshape(len(frame), -1).T for column in columns])
        if order is not None:
            values = np.take(values, order, axis=1)
        quats = values[rows["quats"]]
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
