"""Checks shared by all readers and writers of splat files."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import torch

from studio.errors import StudioError
from studio.gaussians import Gaussians

MAX_SPLATS = 1 << 26
"""Larger than any real frame: a header with more splats is damaged."""

LOGIT_LIMIT = 13.8
"""Replaces infinite opacity logits; the opacity is within 1e-6 of 0 or 1."""


def to_arrays(path: Path, gaussians: Gaussians) -> dict[str, np.ndarray]:
    """The attributes as float32 arrays, with unit quaternions.

    Raises:
        StudioError: there are no splats, a value is not finite, or a quaternion is zero.
    """
    if len(gaussians) == 0:
        raise StudioError("splat_file.no_splats", "there are no splats to write", file=path)
    arrays = {name: tensor.float().numpy() for name, tensor in gaussians.state_dict().items()}
    for name, values in arrays.items():
        if not np.isfinite(values).all():
            raise StudioError(
                "gaussians.not_finite",
                f"a value in {name} is not finite",
                file=path,
                fix="Train the frame again.",
                attribute=name,
            )
    norms = np.linalg.norm(arrays["quats"], axis=1, keepdims=True)
    if (norms == 0).any():
        raise StudioError(
            "gaussians.zero_quaternion",
            f"splat {int(np.argmin(norms))} has a zero quaternion",
            file=path,
            fix="Train the frame again.",
            splat=int(np.argmin(norms)),
        )
    return {**arrays, "quats": arrays["quats"] / norms}


def from_arrays(path: Path, arrays: Mapping[str, np.ndarray]) -> Gaussians:
    """Gaussians from float arrays named as in `Gaussians.ATTRIBUTES`. Infinite logits become +-`LOGIT_LIMIT`.

    Raises:
        StudioError: a value is not finite, or a quaternion is zero.
    """
    values = {name: np.ascontiguousarray(array, dtype=np.float32) for name, array in arrays.items()}
    logits = values["logit_opacities"]
    values["logit_opacities"] = np.where(np.isinf(logits), np.sign(logits) * np.float32(LOGIT_LIMIT), logits)
    for name, array in values.items():
        wrong = ~np.isfinite(array).reshape(len(array), math.prod(array.shape[1:])).all(axis=1)
        if wrong.any():
            splat = int(wrong.argmax())
            raise StudioError(
                "gaussians.not_finite",
                f"{name} of splat {splat} is not finite",
                file=path,
                fix="Fix the file.",
                attribute=name,
                splat=splat,
            )
    flat = ~values["quats"].any(axis=1)
    if flat.any():
        raise StudioError(
            "gaussians.zero_quaternion",
            f"splat {int(flat.argmax())} has a zero quaternion",
            file=path,
            fix="Fix the file.",
            splat=int(flat.argmax()),
        )
    return Gaussians(**{name: torch.from_numpy(array) for name, array in values.items()})
