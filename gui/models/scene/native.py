"""The scene as Open3D draws it: what is handed to it. Without Open3D."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gui.models.scene.contents import SceneContents
from studio.gaussians import Gaussians

MOST_COEFFICIENTS = 9
"""Coefficients of spherical harmonics that Open3D 0.20 draws: those up to degree 2."""


@dataclass(frozen=True, eq=False)
class NativeScene:
    """What Open3D draws.

    Attributes:
        gaussians: the frame's splats; None to leave them out.
        contents: everything else.
    """

    gaussians: Gaussians | None
    contents: SceneContents


def splat_arrays(gaussians: Gaussians) -> dict[str, np.ndarray]:
    """The point attributes of Open3D's splats, float32 and contiguous.

    Returns:
        positions (N, 3), scale (N, 3) linear, rot (N, 4) unit quaternions wxyz, opacity (N, 1) logits, f_dc (N, 3) and,
        above degree 0, f_rest (N, K - 1, 3), with K at most `MOST_COEFFICIENTS`.
    """
    own = gaussians.to("cpu")
    sh = own.sh.detach().float().numpy()
    found = {
        "positions": own.means, "scale": own.scales, "rot": own.unit_quats, "opacity": own.logit_opacities[:, None],
    }  # fmt: skip
    arrays = {name: value.detach().float().numpy() for name, value in found.items()} | {"f_dc": sh[:, 0]}
    if sh.shape[1] > 1:
        arrays["f_rest"] = sh[:, 1:MOST_COEFFICIENTS]
    return {name: np.ascontiguousarray(value) for name, value in arrays.items()}


def encoded(linear: np.ndarray) -> np.ndarray:
    """Linear light in 0 to 1, of any shape, encoded as sRGB (IEC 61966-2-1), 0 to 1."""
    found: np.ndarray = np.where(
        linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 0) ** (1 / 2.4) - 0.055
    )
    return found


def tiled(images: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Images in one, because each texture costs Open3D time and memory.

    Args:
        images: at least one, (h, w, 3) uint8 of any sizes.

    Returns:
        (H, W, 3) uint8, and (N, 4, 2) places of the corners of each image (upper left, upper right, lower right, lower
        left), 0 to 1 across and down.
    """
    wide, high = max(image.shape[1] for image in images), max(image.shape[0] for image in images)
    across = int(np.ceil(np.sqrt(len(images))))
    down = -(-len(images) // across)
    whole = np.zeros((down * high, across * wide, 3), np.uint8)
    corners = np.zeros((len(images), 4, 2))
    for number, image in enumerate(images):
        y, x = (number // across) * high, (number % across) * wide
        h, w = image.shape[:2]
        whole[y : y + h, x : x + w] = image
        # half a pixel inside, so that the neighbor does not shine through
        left, right, top, bottom = x + 0.5, x + w - 0.5, y + 0.5, y + h - 0.5
        corners[number] = [(left, top), (right, top), (right, bottom), (left, bottom)]
    return whole, corners / (whole.shape[1], whole.shape[0])
