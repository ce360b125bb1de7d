"""One view of a frame, measured against the footage."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from torch import Tensor

    from studio.cameras import Camera
    from studio.gaussians import Gaussians

HIGHEST_PSNR = 100.0
"""dB; stands for the infinite PSNR of equal images."""


@dataclass(frozen=True)
class ViewQuality:
    """Quality of one view.

    Attributes:
        psnr: as filmed, dB.
        psnr_color_fit: after the best 3x4 color matrix for this view, fitted on the performer, dB. The color of a
            camera that was not trained on is not known; this is what remains without it.
        ssim: 0 to 1.
        lpips: lower is better; None: not measured.
    """

    psnr: float
    psnr_color_fit: float
    ssim: float
    lpips: float | None = None


@dataclass(frozen=True, eq=False)
class ViewPair:
    """Footage and drawing of one view over the same background, full frame, float32 RGB in 0 to 1.

    Attributes:
        truth: (H, W, 3) footage, composited with the mask.
        drawn: (H, W, 3) splats.
        fitted: (H, W, 3) splats after the best 3x4 color matrix.
        mask: (H, W) uint8.
        background: RGB, 0 to 1.
    """

    truth: np.ndarray
    drawn: np.ndarray
    fitted: np.ndarray
    mask: np.ndarray
    background: tuple[float, ...]

    @property
    def residual(self) -> np.ndarray:
        """(H, W, 3) drawn minus truth."""
        residual: np.ndarray = self.drawn - self.truth
        return residual

    @classmethod
    def of(
        cls,
        gaussians: Gaussians,
        camera: Camera,
        image: np.ndarray,
        mask: np.ndarray,
        background: Sequence[float],
        device: str = "cpu",
    ) -> ViewPair:
        """Draw a view and composite the footage.

        Args:
            gaussians: on any device.
            camera: pinhole camera of `image`.
            image: (H, W, 3) uint8 RGB.
            mask: (H, W) uint8, 255 is the performer.
            background: RGB, 0 to 1.
            device: torch device to draw on.
        """
        import torch

        from studio.color_fit import correct_color, fit_color
        from studio.rasterizer import rasterize

        color = torch.tensor(background, dtype=torch.float32, device=device)
        with torch.no_grad():
            render = rasterize(gaussians.to(device), camera, torch.zeros_like(color))
            rest = (1 - render.alpha)[..., None] * color
            shown = torch.from_numpy(mask).to(device)[..., None].float() / 255
            truth = torch.from_numpy(image).to(device).float() / 255 * shown + color * (1 - shown)
            drawn = (render.image + rest).clamp(0, 1)
            matrix = fit_color(render.image, render.alpha, truth - rest, shown[..., 0] > 0.5)
            fitted = (correct_color(render.image, render.alpha, matrix) + rest).clamp(0, 1)
        images = [each.cpu().numpy() for each in (truth, drawn, fitted)]
        return cls(images[0], images[1], images[2], mask, tuple(background))


def measure_view(
    pair: ViewPair, padding: int | None, lpips: Callable[[Tensor, Tensor], float] | None = None
) -> ViewQuality | None:
    """Measure a view.

    Args:
        pair: footage and drawing.
        padding: pixels around the bounding box of the mask; None: the full frame.
        lpips: the metric, of (H, W, 3) tensors.

    Returns:
        None if the box is empty: the camera does not see the performer.
    """
    from studio.metrics import psnr, ssim

    box = (slice(None), slice(None)) if padding is None else padded_box(pair.mask, padding)
    if box is None:
        return None
    truth, drawn, fitted = (_tensor(image[box]) for image in (pair.truth, pair.drawn, pair.fitted))
    distance = None
    if lpips is not None:
        from studio.perceptual import at_least

        distance = lpips(at_least(drawn, pair.background), at_least(truth, pair.background))
    return ViewQuality(
        min(float(psnr(drawn, truth)), HIGHEST_PSNR),
        min(float(psnr(fitted, truth)), HIGHEST_PSNR),
        float(ssim(drawn, truth)),
        distance,
    )


def padded_box(mask: np.ndarray, padding: int) -> tuple[slice, slice] | None:
    """Rows and columns of the bounding box of an (H, W) uint8 mask above 127, padded by `padding` pixels and clipped
    to the image; None if the mask is empty."""
    rows, columns = np.flatnonzero((mask > 127).any(1)), np.flatnonzero((mask > 127).any(0))
    if rows.size == 0:
        return None
    return (
        slice(max(0, int(rows[0]) - padding), min(mask.shape[0], int(rows[-1]) + 1 + padding)),
        slice(max(0, int(columns[0]) - padding), min(mask.shape[1], int(columns[-1]) + 1 + padding)),
    )


def _tensor(image: np.ndarray) -> Any:
    import torch

    return torch.from_numpy(np.ascontiguousarray(image))
