"""Measures one frame of all takes in a comparison."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

import numpy as np

from pipelines.comparison.finished_frames import FrameOfTake
from pipelines.comparison.opened_takes import OpenedTake
from pipelines.comparison.results import FlickerOfFrame, Measures
from studio.comparison import EvaluationProtocol, ViewPair, flicker, measure_view, padded_box

if TYPE_CHECKING:
    from studio.perceptual import Lpips


@dataclass(frozen=True, eq=False)
class _Residual:
    """What is kept of a view for the flicker of the next frame."""

    values: np.ndarray
    mask: np.ndarray


class FrameMeasurer:
    """Measures frames in order; each one's flicker is against the one before.

    Args:
        takes: the takes.
        cameras: names.
        protocol: which pixels.
        lpips: the metric; None: not measured.
        device: torch device to draw on.
        flicker: measure it; then the residuals of one frame are kept.
    """

    def __init__(
        self,
        takes: Sequence[OpenedTake],
        cameras: Sequence[str],
        protocol: EvaluationProtocol,
        lpips: Lpips | None,
        device: str,
        flicker: bool,
    ) -> None:
        self._takes = takes
        self._cameras = cameras
        self._protocol = protocol
        self._lpips = lpips
        self._device = device
        self._flicker = flicker
        self._before: dict[tuple[str, str], _Residual] = {}
        self._last: int | None = None

    def measure(
        self, frame: int, before: int | None, keep: bool, tick: Callable[[bool], None]
    ) -> tuple[tuple[FrameOfTake, ...], dict[str, list[ViewPair]]]:
        """Measure one frame.

        Args:
            frame: number in the footage.
            before: the frame that flicker is measured against, None for the first one. It is drawn again if it is not
                the one that was measured last.
            keep: return the views.
            tick: called before each view is drawn; True if it is a view of `frame`.

        Returns:
            the figures of each take, and the views by camera, one of each take; empty without `keep`.
        """
        if self._flicker and before is not None and before != self._last:
            self._before = {
                (take.name, camera): _Residual(pair.residual, pair.mask)
                for take in self._takes
                for camera, pair in self._views(take, before, lambda: tick(False))
            }
        views: dict[str, list[ViewPair]] = {camera: [] for camera in self._cameras} if keep else {}
        found = []
        for take in self._takes:
            row: dict[str, Measures] = {}
            changes: list[float] = []
            for camera, pair in self._views(take, frame, lambda: tick(True)):
                quality = measure_view(pair, self._protocol.padding, self._lpips)
                if quality is not None:
                    row[camera] = Measures(**{k: v for k, v in asdict(quality).items() if v is not None})
                if self._flicker:
                    now = _Residual(pair.residual, pair.mask)
                    if before is not None:
                        changes += _change(self._before[take.name, camera], now, self._protocol.padding)
                    self._before[take.name, camera] = now
                if keep:
                    views[camera].append(pair)
            found.append(_figures(take, frame, row, changes))
        self._last = frame
        return tuple(found), views

    def _views(self, take: OpenedTake, frame: int, tick: Callable[[], None]) -> Iterator[tuple[str, ViewPair]]:
        gaussians = take.reader.gaussians(take.frames[frame])
        for camera in self._cameras:
            tick()
            yield (
                camera,
                ViewPair.of(
                    gaussians,
                    take.place.camera(take.footage.rig[camera]),
                    take.footage.image(camera, frame),
                    take.footage.evaluation_mask(camera, frame),
                    self._protocol.background,
                    self._device,
                ),
            )


def _figures(take: OpenedTake, frame: int, row: dict[str, Measures], changes: Sequence[float]) -> FrameOfTake:
    if not changes:
        return FrameOfTake(cameras=row)
    border = frame in take.group_starts
    change = round(sum(changes) / len(changes), 4)
    return FrameOfTake(cameras=row, flicker=FlickerOfFrame(frame=int(frame), flicker=change, group_border=border))


def _change(before: _Residual, now: _Residual, padding: int | None) -> list[float]:
    """Flicker in the box around the performer of both frames; none if one of the masks is empty."""
    if before.values.shape != now.values.shape:
        return []
    box: tuple[slice, ...] | None = (slice(None), slice(None))
    if padding is not None:
        if not ((before.mask > 127).any() and (now.mask > 127).any()):
            return []
        box = padded_box(np.maximum(before.mask, now.mask), padding)
    return [] if box is None else [flicker(before.values[box], now.values[box])]
