"""Checks shared by all readers and writers of splat files."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import torch

from v3studio.studio.bounded_files import read_bounded
from v3studio.studio.errors import StudioError, naming
from v3studio.studio.gaussians import Gaussians
from v3studio.studio.rasterizer import check_finite

Note = Callable[[str], None]
"""Takes what a reader ignored or assumed, as one sentence that is the same for each frame of a sequence."""

MAX_SPLATS = 1 << 26  # larger than any real frame: a header with more splats is damaged
LOGIT_LIMIT = 13.8  # replaces infinite opacity logits; the opacity is within 1e-6 of 0 or 1
LEAST_SCALE = 1e-12  # replaces linear scales of 0, which have no logarithm

_FREE_SIZE, _EXPANSION = 64 << 20, 100
_MOST_BYTES = 256 * MAX_SPLATS  # 62 floats and some more for each splat


def damaged(code: str, problem: str, path: Path, value: Any = None, **fields: Any) -> StudioError:
    """The error for a file with which something went wrong when it was written or copied."""
    return StudioError(code, problem, file=path, value=value, fix="Export or copy it again.", **fields)


@contextmanager
def opening(path: Path) -> Iterator[None]:
    """Errors of the operating system as StudioError."""
    try:
        yield
    except FileNotFoundError:
        raise StudioError("splat_file.not_found", "no such file", file=path) from None
    except OSError as error:
        raise StudioError("splat_file.unreadable", f"cannot be read ({error.strerror})", file=path) from None


def read_bytes(path: Path) -> bytes:
    """The whole file."""
    with opening(path):
        return read_bounded(path, _MOST_BYTES)


def truncated(path: Path, found: int, expected: int) -> StudioError:
    """The error for a file that ends early; sizes in bytes."""
    return damaged(
        "splat_file.truncated", f"the file ends after {found} of {expected} bytes", path, found, expected=expected
    )


def check_count(path: Path, count: int) -> None:
    """Raises StudioError (splat_file.splat_count) unless there are 1 to `MAX_SPLATS` splats."""
    if not 0 < count <= MAX_SPLATS:
        problem = f"the file has {count} splats; expected 1 to {MAX_SPLATS}"
        fix = "Remove the file from the sequence, or export it again."
        raise StudioError("splat_file.splat_count", problem, file=path, value=count, fix=fix)


def check_expansion(path: Path, size: int, stored: int) -> None:
    """Bound what a small file can make a reader allocate: bytes after decompression, and in the file.

    Splats do not compress a hundredfold: their positions alone take more than a hundredth. Files with a reader's
    64 MiB or less are not limited.
    """
    if size > max(_FREE_SIZE, _EXPANSION * stored):
        problem = f"{stored} bytes claim to contain {size}, which splats cannot be compressed to"
        raise damaged("splat_file.expansion", problem, path, size, expected=_EXPANSION * stored)


def logits(opacities: np.ndarray) -> np.ndarray:
    """Logits of opacities from 0 to 1; infinite at the ends."""
    with np.errstate(divide="ignore"):
        return np.log(opacities) - np.log1p(-opacities)


def log_scales(scales: np.ndarray) -> np.ndarray:
    """Logarithms of linear scales; those of 0 become `LEAST_SCALE`, negative ones not a number."""
    with np.errstate(invalid="ignore"):
        return np.log(np.where(scales == 0, LEAST_SCALE, scales))


def to_arrays(path: Path, gaussians: Gaussians) -> dict[str, np.ndarray]:
    """The attributes as float32 arrays, with unit quaternions."""
    if len(gaussians) == 0:
        raise StudioError("splat_file.no_splats", "there are no splats to write", file=path)
    single = gaussians.to(torch.float32)
    with naming(path):
        check_finite(single)
    arrays = {name: tensor.numpy() for name, tensor in single.on_cpu().items()}
    return {**arrays, "quats": arrays["quats"] / np.linalg.norm(arrays["quats"], axis=1, keepdims=True)}


def from_arrays(arrays: Mapping[str, np.ndarray], dtype: type[np.floating[Any]] = np.float32) -> Gaussians:
    """Gaussians from float arrays named as in `Gaussians.ATTRIBUTES`; float64 if positions have that many digits.

    Infinite logits become +-`LOGIT_LIMIT`. All rows are kept, so that splats correspond from frame to frame; `usable`
    says which of them can be rendered.
    """
    with np.errstate(invalid="ignore", over="ignore"):  # what does not fit is not usable
        values = {name: np.ascontiguousarray(array, dtype=dtype) for name, array in arrays.items()}
    logits = values["logit_opacities"]
    values["logit_opacities"] = np.where(np.isinf(logits), np.sign(logits) * dtype(LOGIT_LIMIT), logits)
    return Gaussians.from_state_dict({name: torch.from_numpy(array) for name, array in values.items()})


def usable(gaussians: Gaussians) -> np.ndarray:
    """(N,) bool: whether all values of a splat are finite, its linear scales too, and its quaternion is not zero."""
    finite = [tensor.reshape(len(gaussians), -1).isfinite().all(dim=1) for _, tensor in gaussians.items()]
    whole = torch.stack([*finite, gaussians.scales.isfinite().all(dim=1), gaussians.quats.any(dim=1)]).all(dim=0)
    indices: np.ndarray = whole.numpy()
    return indices


def check_some_usable(path: Path, kept: np.ndarray) -> None:
    """Raises StudioError (splat_file.no_usable_splats) if no splat can be rendered."""
    if not kept.any():
        problem = (
            f"each of its {len(kept)} splats has a value that is not finite, an infinite scale or a zero quaternion"
        )
        raise damaged("splat_file.no_usable_splats", problem, path, len(kept))


def quats_of_three(stored: np.ndarray, largest: np.ndarray) -> np.ndarray:
    """(N, 4) unit quaternions in the order of the file's components, from the (N, 3) others and the (N,) index, 0 to 3,
    of the positive one that is not stored."""
    quats = np.empty((len(stored), 4))
    for index in range(4):
        chosen = largest == index
        others = [component for component in range(4) if component != index]
        quats[np.ix_(chosen, others)] = stored[chosen]
        quats[chosen, index] = np.sqrt(np.maximum(0, 1 - (stored[chosen] ** 2).sum(axis=1)))
    return quats
