"""Measures one frame of all takes in a comparison, and shows the takes side by side."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from v3studio.pipelines.comparison.opened_takes import OpenedTake
from v3studio.pipelines.comparison.results import FlickerOfFrame, FrameOfTake, Measures
from v3studio.pipelines.reports.evaluation import DIFFERENCE_GAIN
from v3studio.pipelines.reports.images import to_bytes
from v3studio.studio.comparison import EvaluationProtocol, Residual, ViewPair, flicker_of, measure, padded_box

if TYPE_CHECKING:
    from v3studio.studio.perceptual import Lpips

_LABEL_HEIGHT, _GAP = 18, 2


@dataclass(eq=False)
class FrameMeasurer:
    """Measures frames in order; with `flicker`, each one's flicker is against the one before."""

    takes: Sequence[OpenedTake]
    cameras: Sequence[str]
    protocol: EvaluationProtocol
    lpips: Lpips | None
    device: str
    flicker: bool

    def __post_init__(self) -> None:
        self._before: dict[str, dict[str, Residual]] = {}  # residuals of the frame before by take and camera
        self._last: int | None = None

    def measure(
        self, frame: int, before: int | None, keep: bool, tick: Callable[[bool], None]
    ) -> tuple[tuple[FrameOfTake, ...], dict[str, dict[str, ViewPair]]]:
        """The figures of each take in one frame, and the views by camera and name of the take (none without `keep`).
        Flicker is against the frame `before`, if there is one, which is rendered again unless it was measured last."""
        if self.flicker and before is not None and before != self._last:
            for take in self.takes:
                pairs = self._pairs(take, before, lambda: tick(False))
                self._before[take.name] = {camera: pair.residual for camera, pair in pairs}
        views: dict[str, dict[str, ViewPair]] = {}
        frames = []
        for take in self.takes:
            row: dict[str, Measures] = {}
            residuals: dict[str, Residual] = {}
            for camera, pair in self._pairs(take, frame, lambda: tick(True)):
                row[camera] = measure(pair, self.lpips)
                residuals[camera] = pair.residual
                if keep:
                    views.setdefault(camera, {})[take.name] = pair
            change = flicker_of(self._before[take.name], residuals) if self.flicker and before is not None else None
            flicker = None
            if change is not None:
                flicker = FlickerOfFrame(frame=int(frame), flicker=change, group_border=frame in take.group_starts)
            frames.append(FrameOfTake(cameras=row, flicker=flicker))
            self._before[take.name] = residuals
        self._last = frame
        return tuple(frames), views

    def _pairs(self, take: OpenedTake, frame: int, tick: Callable[[], None]) -> Iterator[tuple[str, ViewPair]]:
        """The views of cameras that see the performer."""
        gaussians, padding = take.reader.gaussians(take.frames[frame]), self.protocol.padding
        for camera in self.cameras:
            tick()
            mask = take.footage.evaluation_mask(camera, frame)
            box = None if padding is None else padded_box(mask, padding)
            if padding is None or box is not None:
                place = take.place.camera(take.footage.rig[camera])
                image, background = take.footage.image(camera, frame), self.protocol.background
                yield camera, ViewPair.of(gaussians, place, image, mask, background, box, self.device, fit=True)


def side_by_side(pairs: dict[str, ViewPair]) -> np.ndarray:
    """A view of the footage and each take; below, the amplified difference from the footage. (H, W, 3) uint8."""
    footage = next(iter(pairs.values())).footage
    columns = [[_labeled("footage", footage), _labeled(f"difference x{DIFFERENCE_GAIN:g}", np.zeros_like(footage))]]
    for name, pair in pairs.items():
        difference = np.clip(np.abs(pair.rendered - pair.footage) * DIFFERENCE_GAIN, 0, 1)
        columns.append([_labeled(name, pair.rendered), _labeled("", difference)])
    rows = [_joined([column[row] for column in columns], axis=1) for row in (0, 1)]
    return _joined(rows, axis=0)


def _labeled(text: str, image: np.ndarray) -> np.ndarray:
    """The image below a line of text; letters that OpenCV lacks become question marks."""
    import cv2

    strip = np.full((_LABEL_HEIGHT, image.shape[1], 3), 255, np.uint8)
    plain = text.encode("ascii", "replace").decode()
    cv2.putText(strip, plain, (2, 13), cv2.FONT_HERSHEY_SIMPLEX, 0.4, (0, 0, 0), 1, cv2.LINE_AA)
    return np.concatenate([strip, to_bytes(image)])


def _joined(images: Sequence[np.ndarray], axis: int) -> np.ndarray:
    """Images in a row (axis 1) or column (axis 0), smaller ones padded with white."""
    other = 1 - axis
    size = max(image.shape[other] for image in images)
    parts = []
    for image in images:
        edges = [[0, 0], [0, 0], [0, 0]]
        edges[other][1] = size - image.shape[other]
        edges[axis][1] = _GAP
        parts.append(np.pad(image, edges, constant_values=255))
    return np.concatenate(parts, axis=axis)
