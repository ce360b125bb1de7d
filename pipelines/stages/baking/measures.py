"""Errors of encoding and contributions of splats, measured in rendered images."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from v3studio.pipelines.reports.images import render
from v3studio.studio.comparison import padded_box

if TYPE_CHECKING:
    from v3studio.studio.cameras import Camera
    from v3studio.studio.gaussians import Gaussians

_WIDTH = 640  # largest width of rendered images in pixels


@dataclass(eq=False)
class RenderedError:
    """Mean squared error of decoded frames against trained ones, for levels of quality. Both are rendered from two
    training cameras, usually on opposite sides of the performer and other ones in each frame, and compared in the
    bounding box of the foreground."""

    frames: Sequence[Gaussians]
    cameras: Sequence[Camera]
    background: Sequence[float]
    device: str

    def __post_init__(self) -> None:
        self._trained: dict[int, list[np.ndarray]] = {}

    def __call__(self, index: int, decoded: Gaussians) -> float:
        """Mean squared error over the cameras, colors in 0 to 1; `index` counts within the group."""
        if index not in self._trained:
            self._trained[index] = self._render(index, self.frames[index])
        errors, background = [], np.array(self.background, dtype=np.float32)
        for trained, image in zip(self._trained[index], self._render(index, decoded), strict=True):
            differs = (np.abs(trained - background) > 1 / 255).any(axis=2)
            box = padded_box(np.where(differs, 255, 0), 0) or (slice(None), slice(None))
            errors.append(float(np.square(trained[box] - image[box]).mean()))
        return sum(errors) / len(errors)

    def _render(self, index: int, gaussians: Gaussians) -> list[np.ndarray]:
        count = len(self.cameras)
        chosen = sorted({index % count, (index + count // 2) % count})
        return [render(gaussians, self.cameras[number], self.background, self.device, _WIDTH) for number in chosen]


def rendered_contribution(
    frames: Sequence[Gaussians], cameras: Sequence[Camera], device: str, check: Callable[[], None]
) -> np.ndarray:
    """(N,) float64: splats' blending weights in all training views of the first, middle and last frame."""
    from v3studio.studio.rasterizer.contribution import contribution

    total: np.ndarray | None = None
    for position in sorted({0, len(frames) // 2, len(frames) - 1}):
        gaussians = frames[position]
        for camera in cameras:
            check()
            smaller = camera.scaled(_WIDTH / camera.width) if camera.width > _WIDTH else camera
            seen = contribution(gaussians.to(device), [smaller]).cpu().numpy()
            total = seen if total is None else total + seen
    assert total is not None
    return total
