"""SplatVideo: frames of Gaussians that play at a rate, wherever they come from. What exports take and imports give."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from studio.cameras import Camera
from studio.errors import StudioError
from studio.gaussians import Gaussians


@dataclass(frozen=True, eq=False)
class SplatVideo:
    """A Gaussian video.

    Attributes:
        name: of the folder, file or address, for messages.
        fps: frames a second to play at.
        frame_count: at least 1.
        group_starts: ascending, the first is 0; from one to the next each frame has the same splats in the same order.
        read: gives the frame of an index from 0 to frame_count - 1, float32; called on one thread at a time.
        up: (3,) unit vector that points up in the world; None where nothing tells.
        view: a camera that sees the subject well; None where none is known.
        background: RGB, 0 to 1, to draw over.
    """

    name: str
    fps: float
    frame_count: int
    group_starts: tuple[int, ...]
    read: Callable[[int], Gaussians]
    up: np.ndarray | None = None
    view: Camera | None = None
    background: tuple[float, float, float] = (0.0, 0.0, 0.0)
    numbers: tuple[int, ...] = field(default=())
    """What each frame is called where it is not its index: after `part`, its index in the whole."""

    def __post_init__(self) -> None:
        if self.frame_count < 1 or not self.group_starts or self.group_starts[0] != 0:
            raise StudioError(f"{self.name}: there are no frames.")

    def __iter__(self) -> Iterator[Gaussians]:
        for index in range(self.frame_count):
            yield self.read(index)

    def number(self, index: int) -> int:
        """What the frame is called."""
        return self.numbers[index] if self.numbers else index

    @property
    def groups(self) -> tuple[range, ...]:
        """Indices of each group's frames."""
        ends = (*self.group_starts[1:], self.frame_count)
        return tuple(range(start, end) for start, end in zip(self.group_starts, ends, strict=True))

    @property
    def duration(self) -> float:
        """Seconds."""
        return self.frame_count / self.fps

    def part(self, start: int = 0, stop: int | None = None, step: int = 1) -> SplatVideo:
        """Frames start, start + step, ... below `stop` (all by default). The rate is divided by the step.

        Raises:
            StudioError: there are no such frames.
        """
        end = self.frame_count if stop is None else stop
        if not 0 <= start < end <= self.frame_count or step < 1:
            raise StudioError(
                f"{self.name}: frames {start}:{end}:{step} were asked for; it has the frames 0 to "
                f"{self.frame_count - 1}, written 0:{self.frame_count}."
            )
        chosen = range(start, end, step)
        read = self.read
        starts = []
        for group in self.groups:
            inside = [position for position, index in enumerate(chosen) if index in group]
            starts += inside[:1]
        return replace(
            self,
            fps=self.fps / step,
            frame_count=len(chosen),
            group_starts=tuple(starts),
            read=lambda index: read(chosen[index]),
            numbers=tuple(self.number(index) for index in chosen),
        )
