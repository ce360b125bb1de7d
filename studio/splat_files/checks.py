"""What all writers and readers of splat files check."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import torch

from studio.errors import StudioError
from studio.gaussians import Gaussians

MAX_SPLATS = 1 << 26
"""More than any file of one frame has; a head that promises more is damaged."""

LOGIT_LIMIT = 13.8
"""Logits of opacity beyond this (opacity within 1e-6 of 0 or 1) say no more; files have infinities there."""


def to_arrays(path: Path, gaussians: Gaussians) -> dict[str, np.ndarray]:
    """The attributes as float32 arrays, quaternions of length 1.

    Raises:
        StudioError: no splats, or a value that is not finite.
    """
    if len(gaussians) == 0:
        raise StudioError(f"{path}: there are no splats to write.")
    arrays = {name: tensor.float().numpy() for name, tensor in gaussians.state_dict().items()}
    for name, values in arrays.items():
        if not np.isfinite(values).all():
            raise StudioError(
                f"{path}: a splat's {name} is not finite, so the frame cannot be written; train it again."
            )
    norms = np.linalg.norm(arrays["quats"], axis=1, keepdims=True)
    if (norms == 0).any():
        raise StudioError(f"{path}: splat {int(np.argmin(norms))} has a quaternion of length 0; train it again.")
    return {**arrays, "quats": arrays["quats"] / norms}


def from_arrays(path: Path, arrays: Mapping[str, np.ndarray]) -> Gaussians:
    """Gaussians of float arrays named as `Gaussians.ATTRIBUTES`; infinite logits become `LOGIT_LIMIT`.

    Raises:
        StudioError: a value is not a number, or a quaternion has length 0.
    """
    values = {name: np.ascontiguousarray(array, dtype=np.float32) for name, array in arrays.items()}
    logits = values["logit_opacities"]
    values["logit_opacities"] = np.where(np.isinf(logits), np.sign(logits) * np.float32(LOGIT_LIMIT), logits)
    for name, array in values.items():
        wrong = ~np.isfinite(array).reshape(len(array), math.prod(array.shape[1:])).all(axis=1)
        if wrong.any():
            raise StudioError(f"{path}: {name} of splat {int(wrong.argmax())} is not a finite number; mend the file.")
    flat = ~values["quats"].any(axis=1)
    if flat.any():
        raise StudioError(f"{path}: the rotation of splat {int(flat.argmax())} has length 0; mend the file.")
    return Gaussians(**{name: torch.from_numpy(array) for name, array in values.items()})
