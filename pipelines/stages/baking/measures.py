"""Errors of encoding and contributions of splats, measured in rendered images."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from pipelines.reports.images import render
from pipelines.stages.compared_view import ComparedView, compared_cameras, compared_view
from pipelines.stages.inputs import Inputs

if TYPE_CHECKING:
    from studio.cameras import Camera
    from studio.gaussians import Gaussians

Item = TypeVar("Item")

_CAMERAS = 4
"""Most cameras from which errors are measured, evenly spaced in their order."""

_WIDTH = 640
"""Largest width of rendered images in pixels."""


class RenderedError:
    """Mean squared error of decoded frames against trained ones, for a target PSNR.

    Both are rendered from a few cameras around the performer and compared in the bounding box of the foreground.

    Args:
        frames: the trained frames of the group, with the take's edits.
        cameras: the training cameras, in the world of the frames.
        background: RGB, 0 to 1.
    """

    def __init__(
        self, frames: Sequence[Gaussians], cameras: Sequence[Camera], background: Sequence[float], device: str
    ) -> None:
        self._frames, self._background, self._device = frames, background, device
        self._cameras = _evenly(cameras)
        self._trained: dict[int, list[np.ndarray]] = {}

    def __call__(self, index: int, decoded: Gaussians) -> float:
        """Mean squared error over the cameras, colors in 0 to 1; `index` counts within the group."""
        if index not in self._trained:
            self._trained[index] = self._render(self._frames[index])
        errors = []
        for trained, found in zip(self._trained[index], self._render(decoded), strict=True):
            box = foreground_box(trained, self._background)
            errors.append(float(np.square(trained[box] - found[box]).mean()))
        return sum(errors) / len(errors)

    def _render(self, gaussians: Gaussians) -> list[np.ndarray]:
        return [render(gaussians, camera, self._background, self._device, _WIDTH) for camera in self._cameras]


def foreground_box(image: np.ndarray, background: Sequence[float]) -> tuple[slice, slice]:
    """Rows and columns of the bounding box of everything that differs from the background; all if nothing does.

    Args:
        image: (H, W, 3), 0 to 1.
        background: RGB, 0 to 1.
    """
    differs = (np.abs(image - np.array(background, dtype=np.float32)) > 1 / 255).any(axis=2)
    rows, columns = np.flatnonzero(differs.any(axis=1)), np.flatnonzero(differs.any(axis=0))
    if rows.size == 0:
        return slice(None), slice(None)
    return slice(int(rows[0]), int(rows[-1]) + 1), slice(int(columns[0]), int(columns[-1]) + 1)


class FilmedError:
    """Squared errors against the footage, in the views of the evaluation, for a limit to the loss of each frame.

    These are the held-out cameras. Splats are fitted closer to training cameras than to any other view, so the same
    error of encoding counts for more there: a limit of 0.4 dB took twice the bytes. Without held-out cameras, they are
    training cameras.

    Args:
        frames: the trained frames of the group, with the take's edits.
        numbers: their frame numbers in the footage.
        check: raises Cancelled if the run was cancelled.

    Attributes:
        losses: dB that encoding costs, by index in the group, as last measured.
    """

    def __init__(
        self, inputs: Inputs, frames: Sequence[Gaussians], numbers: Sequence[int], check: Callable[[], None]
    ) -> None:
        self._inputs, self._frames, self._numbers, self._check = inputs, frames, numbers, check
        self._names = _evenly(compared_cameras(inputs.footage.trained))
        self._trained: dict[int, float] = {}
        self.losses: dict[int, float] = {}

    def __call__(self, index: int, decoded: Gaussians) -> tuple[float, float]:
        """Errors of the trained and of the decoded frame, as geometric means over the cameras, so that their ratio is
        the mean of what the cameras lose in dB; `index` counts within the group.
        """
        from studio.stream.encode.quality import loss

        self._check()
        found = [compared_view(self._inputs, name, self._numbers[index]) for name in self._names]
        views = [view for view in found if view is not None]
        if index not in self._trained:
            self._trained[index] = self._error(self._frames[index], views)
        errors = self._trained[index], self._error(decoded, views)
        self.losses[index] = loss(*errors)
        return errors

    def _error(self, gaussians: Gaussians, views: Sequence[ComparedView]) -> float:
        if not views:
            return 0.0
        pairs = [view.pair(gaussians) for view in views]
        errors = [np.square(pair.rendered - pair.footage).mean(dtype=np.float64) for pair in pairs]
        return float(np.exp(np.mean(np.log(np.maximum(errors, 1e-12)))))


def rendered_contribution(
    frames: Sequence[Gaussians], cameras: Sequence[Camera], device: str, check: Callable[[], None]
) -> np.ndarray:
    """What each splat adds to the images of the training cameras, for rungs with fewer splats.

    Measured in the first, the middle and the last frame, from all training cameras.

    Returns:
        (N,) float64: sum over views of the splat's blending weights.
    """
    from studio.rasterizer.contribution import contribution

    total: np.ndarray | None = None
    for position in sorted({0, len(frames) // 2, len(frames) - 1}):
        gaussians = frames[position]
        for camera in cameras:
            check()
            smaller = camera.scaled(_WIDTH / camera.width) if camera.width > _WIDTH else camera
            found = contribution(gaussians.to(device), [smaller]).cpu().numpy()
            total = found if total is None else total + found
    assert total is not None
    return total


def _evenly(items: Sequence[Item]) -> list[Item]:
    chosen = np.linspace(0, len(items), min(_CAMERAS, len(items)), endpoint=False).astype(int)
    return [items[index] for index in chosen]
