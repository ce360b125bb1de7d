"""SplatVideo: a sequence of Gaussians with a frame rate, from any source. Exports read it; imports return it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from v3studio.studio.audio.pcm import Pcm, part_of
from v3studio.studio.cameras import Camera
from v3studio.studio.counts import short_repr
from v3studio.studio.errors import StudioError
from v3studio.studio.gaussians import Gaussians
from v3studio.studio.similarity import Similarity


@dataclass(frozen=True, eq=False)
class SplatVideo:
    """A Gaussian video.

    Attributes:
        name: name of the folder, file or URL, for messages.
        fps: playback rate in frames per second.
        frame_count: number of frames, at least 1.
        group_starts: first frame of each group, ascending from 0. Within a group, all frames have the same splats in
            the same order.
        read: returns the frame of an index from 0 to frame_count - 1, float32; called from one thread at a time.
        up: (3,) unit vector that points up in the world; None if unknown.
        view: a camera with a good view of the performer; None if unknown.
        background: RGB color behind the splats, 0 to 1.
        behind: returns the splats of the set behind the performer, the same in all frames; None if there are none.
        sound: its sample 0 sounds when frame 0 appears; None: silent.
        original: from the world of the splats to that of the cameras they were trained from, without rotation; exports
            apply it.
        notes: what its reader ignored or assumed, one sentence each.

    Raises:
        StudioError: there are no frames (splat_video.no_frames).
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
    """Frame numbers, ascending, if they differ from the indices: those of the footage, or those before `part`."""
    behind: Callable[[], Gaussians | None] = lambda: None
    sound: Pcm | None = None
    original: Similarity = field(default_factory=Similarity)
    notes: tuple[str, ...] = ()

    __repr__ = short_repr

    def __post_init__(self) -> None:
        if self.frame_count < 1 or not self.group_starts or self.group_starts[0] != 0:
            raise StudioError("splat_video.no_frames", "the Gaussian video has no frames", file=self.name)

    def __iter__(self) -> Iterator[Gaussians]:
        for index in range(self.frame_count):
            yield self.read(index)

    def number(self, index: int) -> int:
        """The frame number of an index."""
        return self.numbers[index] if self.numbers else index

    @property
    def groups(self) -> tuple[range, ...]:
        """The frame indices of each group."""
        ends = (*self.group_starts[1:], self.frame_count)
        return tuple(range(start, end) for start, end in zip(self.group_starts, ends, strict=True))

    @property
    def duration(self) -> float:
        """Duration in seconds."""
        return self.frame_count / self.fps

    def part(self, start: int | None = None, stop: int | None = None, step: int = 1) -> SplatVideo:
        """Every `step`th of the frames with numbers from `start` (None: the first) to `stop` - 1 (None: the last), at a
        frame rate divided by the step. StudioError (splat_video.frame_range): the range is empty or out of bounds."""
        first, end = self.number(0), self.number(self.frame_count - 1) + 1
        low, high = first if start is None else start, end if stop is None else stop
        chosen = [index for index in range(self.frame_count) if low <= self.number(index) < high][:: max(step, 1)]
        if not first <= low < high <= end or step < 1 or not chosen:
            problem = f"no frames {low}:{high}:{step} in a video of the frames {first} to {end - 1}"
            value = [low, high, step]
            fix = f"Choose a range within {first}:{end}."
            raise StudioError(
                "splat_video.frame_range", problem, file=self.name, value=value, fix=fix, expected=[first, end]
            )
        read, seconds = self.read, len(chosen) * step / self.fps
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
            sound=None if self.sound is None else part_of(self.sound, chosen[0] / self.fps, seconds),
        )
