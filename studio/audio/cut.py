"""Cuts a sound to the frames of a take."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from v3studio.studio.audio.sound_file import SAMPLE_RATE, SoundFile
from v3studio.studio.errors import StudioError


@dataclass
class Cut:
    """A part of a sound file, of exactly `samples` samples at `SAMPLE_RATE`; silence where the file has none.

    `first`: number of the first sample, counted from the file's time 0; may be negative. `missing_before`,
    `missing_after`: seconds without sound at both ends; known after `blocks` has been read to its end.
    """

    file: SoundFile
    first: int
    samples: int
    missing_before: float = 0.0
    missing_after: float = 0.0

    @property
    def channels(self) -> int:
        """1 or 2."""
        return self.file.channels

    def blocks(self) -> Iterator[np.ndarray]:
        """The samples in order, (n, channels) float32; StudioError: unreadable, or nothing there (`audio.outside`)."""
        done = 0
        for position, samples in self.file.blocks():
            low = position - self.first
            if low >= self.samples:
                break
            samples = samples[max(done - low, 0) : self.samples - low]
            low = max(low, done)
            if not len(samples):
                continue
            if low > done:
                if done == 0:
                    self.missing_before = low / SAMPLE_RATE
                yield from _silence(low - done, self.channels)
            yield samples
            done = low + len(samples)
        if done == 0:
            raise outside(self)
        self.missing_after = (self.samples - done) / SAMPLE_RATE
        yield from _silence(self.samples - done, self.channels)


def cut_sound(file: SoundFile, start: float, seconds: float) -> Cut:
    """The part of a sound that begins `start` seconds after the file's time 0 and takes `seconds`; StudioError
    (`audio.outside`) if the file says that it has no sound there."""
    cut = Cut(file, round(start * SAMPLE_RATE), max(1, round(seconds * SAMPLE_RATE)))
    if start + seconds <= 0 or (file.duration is not None and file.duration <= start):
        raise outside(cut)
    return cut


def outside(cut: Cut) -> StudioError:
    """The error for a sound that does not overlap the take."""
    start, seconds = cut.first / SAMPLE_RATE, cut.samples / SAMPLE_RATE
    return StudioError(
        "audio.outside",
        f"the sound has nothing in the take, whose {seconds:.2f} s begin {abs(start):.2f} s "
        f"{'before' if start < 0 else 'after'} the sound's beginning",
        file=cut.file.path,
        value=start,
        fix="Change capture.audio_offset.",
        setting="capture.audio_offset",
        duration=cut.file.duration,
    )


def _silence(count: int, channels: int) -> Iterator[np.ndarray]:
    for start in range(0, count, SAMPLE_RATE):
        yield np.zeros((min(SAMPLE_RATE, count - start), channels), np.float32)
