"""One view of a frame: the footage and rendered splats, over the same background; and how their difference flickers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from v3studio.studio.cameras import Camera
    from v3studio.studio.gaussians import Gaussians


UNCUT_PADDING = 8
"""Pixels around the box of `UncutPair`."""


@dataclass(frozen=True, eq=False)
class Residual:
    """Rendered minus footage in the box (rows and columns) of a view, (h, w, 3) float16, colors in 0 to 1, kept from
    one frame to the next to measure flicker."""

    box: tuple[slice, slice]
    values: np.ndarray


@dataclass(frozen=True, eq=False)
class Behind:
    """The image behind the performer in a view, (H, W, 3) float32 RGB in 0 to 1; where the performer is, by mask or by
    difference from it, (H, W) bool; and the splats of the set, which then take the place of the image."""

    image: np.ndarray
    performer: np.ndarray
    scene: Gaussians | None = None


@dataclass(frozen=True, eq=False)
class UncutPair:
    """The uncut footage, and splats before what is behind them, of the whole view; float32 RGB in 0 to 1. `performer`:
    as in `Behind`; `box`: rows and columns around it."""

    footage: np.ndarray  # (H, W, 3)
    rendered: np.ndarray  # (H, W, 3)
    performer: np.ndarray
    box: tuple[slice, slice]
    fitted: np.ndarray | None = None  # (H, W, 3) `rendered` after the best 3x4 color matrix; None: without such splats


@dataclass(frozen=True, eq=False)
class ViewPair:
    """Footage and rendered splats in the box of a view, float32 RGB in 0 to 1."""

    footage: np.ndarray  # (h, w, 3), composited with the mask
    rendered: np.ndarray  # (h, w, 3) splats
    background: tuple[float, ...]  # RGB, 0 to 1
    box: tuple[slice, slice]  # rows and columns of the image
    # (h, w) float32 distance of pixels from the nearest one on the other side of the mask's outline, negative outside
    # of the performer
    depth: np.ndarray
    fitted: np.ndarray | None = None  # (h, w, 3) splats after the best 3x4 color matrix; None: it was not asked for
    uncut: UncutPair | None = None  # None: what is behind the performer is not known

    @property
    def residual(self) -> Residual:
        """Rendered minus footage."""
        return Residual(self.box, (self.rendered - self.footage).astype(np.float16))

    @classmethod
    def of(
        cls,
        gaussians: Gaussians,
        camera: Camera,
        image: np.ndarray,
        mask: np.ndarray,
        background: Sequence[float],
        box: tuple[slice, slice] | None = None,
        device: str = "cpu",
        fit: bool = False,
        behind: Behind | None = None,
    ) -> ViewPair:
        """Render a view and composite (H, W, 3) uint8 RGB footage by its (H, W) uint8 mask over RGB in 0 to 1. With
        `behind`, splats are also drawn before that, for comparison with the uncut footage."""
        import torch

        from v3studio.studio.color_fit import correct_color, fit_color
        from v3studio.studio.gaussians import Gaussians
        from v3studio.studio.rasterizer import rasterize

        box = (slice(0, camera.height), slice(0, camera.width)) if box is None else box
        color = torch.tensor(background, dtype=torch.float32, device=device)
        with torch.no_grad():
            render = rasterize(gaussians.to(device), camera, torch.zeros_like(color))
            rest = (1 - render.alpha)[..., None] * color
            shown = torch.from_numpy(mask).to(device)[..., None].float() / 255
            whole = torch.from_numpy(image).to(device).float() / 255
            footage = whole * shown + color * (1 - shown)
            images = [footage, (render.image + rest).clamp(0, 1)]
            if fit:
                matrix = fit_color(render.image, render.alpha, footage - rest, shown[..., 0] > 0.5)
                images.append((correct_color(render.image, render.alpha, matrix) + rest).clamp(0, 1))
            uncut = None
            if behind is not None:
                over = render.image + (1 - render.alpha)[..., None] * torch.from_numpy(behind.image).to(device)
                own = None
                if behind.scene is not None:
                    scene = behind.scene.to(device).with_sh_degree(gaussians.sh_degree)
                    both = Gaussians.cat(scene, gaussians.to(device))
                    over, ones = rasterize(both, camera, torch.zeros_like(color)).image, torch.ones_like(render.alpha)
                    own = correct_color(over, ones, fit_color(over, ones, whole)).clamp(0, 1).cpu().numpy()
                around = padded_box(behind.performer.astype(np.uint8) * 255, UNCUT_PADDING) or box
                uncut = UncutPair(whole.cpu().numpy(), over.clamp(0, 1).cpu().numpy(), behind.performer, around, own)
        cut = [each[box].cpu().numpy() for each in images]
        return cls(cut[0], cut[1], tuple(background), box, outline_depth(mask)[box], cut[2] if fit else None, uncut)


def outline_depth(mask: np.ndarray) -> np.ndarray:
    """Distance of each pixel of an (H, W) uint8 mask from the nearest one on the other side of its outline, where it
    crosses 127: (H, W) float32 pixels, positive on the performer, negative elsewhere."""
    import cv2

    inside = (mask > 127).astype(np.uint8)
    within, beyond = (cv2.distanceTransform(side, cv2.DIST_L2, cv2.DIST_MASK_PRECISE) for side in (inside, 1 - inside))
    return np.asarray(within - beyond, np.float32)


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


def flicker(before: np.ndarray, now: np.ndarray) -> float:
    """RMS change of the residual (rendered minus footage, (H, W, 3), colors in 0 to 1) between two consecutive frames
    of one camera, in levels of 0 to 255.

    An error that stays, such as blur, does not flicker; motion that is reproduced does not either. The footage's own
    noise is part of it, equally for all that is compared with the same footage.
    """
    return float(np.sqrt(np.square((now - before).astype(np.float64)).mean()) * 255)


def flicker_of(before: Mapping[str, Residual], now: Mapping[str, Residual]) -> float | None:
    """Flicker between consecutive frames where boxes overlap, mean over cameras, 0 to 255; None if they never do."""
    flickers = []
    for camera in sorted(set(before) & set(now)):
        earlier, other = before[camera], now[camera]
        spans = [(max(a.start, b.start), min(a.stop, b.stop)) for a, b in zip(earlier.box, other.box, strict=True)]
        if all(start < stop for start, stop in spans):
            parts = []
            for each in (earlier, other):
                rows, columns = (
                    slice(start - side.start, stop - side.start)
                    for (start, stop), side in zip(spans, each.box, strict=True)
                )
                parts.append(each.values[rows, columns].astype(np.float32))
            flickers.append(flicker(*parts))
    return round(sum(flickers) / len(flickers), 4) if flickers else None
