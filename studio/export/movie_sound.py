"""The sound of a movie: that of the splat video, wherever the movie shows it at its own speed."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction

import numpy as np

from studio.audio import Pcm
from studio.splat_video import SplatVideo

_STEADY = 0.5
"""Frames by which a movie's frame may differ from that of steady playback."""


class MovieSound:
    """Sound by movie time, which continues over the loops of the video.

    Args:
        sound: of the video.
        start: video time at the movie's beginning, seconds.
        duration: of the video, seconds, after which it starts over.
    """

    def __init__(self, sound: Pcm, start: float, duration: float) -> None:
        self.sample_rate = sound.sample_rate
        self.channels = sound.channels
        self._sound = sound
        self._start = start
        self._duration = duration
        self._done = 0

    def until(self, time: Fraction | float) -> np.ndarray:
        """The samples from where the last call ended up to a movie time in seconds, (n, channels) float32."""
        end = round(time * self.sample_rate)
        out = np.zeros((max(end - self._done, 0), self.channels), np.float32)
        filled = 0
        while filled < len(out):
            at = (self._start + (self._done + filled) / self.sample_rate) % self._duration
            left = max(round((self._duration - at) * self.sample_rate), 1)
            count = min(left, len(out) - filled)
            out[filled : filled + count] = self._sound.read(round(at * self.sample_rate), count)
            filled += count
        self._done = max(end, self._done)
        return out


def movie_sound(
    video: SplatVideo, frame: Callable[[float], float], seconds: float, fps: float
) -> tuple[MovieSound | None, str]:
    """The sound of a movie of `video`, and the reason if it is left out.

    Args:
        video: the splat video.
        frame: returns the frame of the video at a movie time in seconds, as for `render_movie`.
        seconds, fps: of the movie.

    Returns:
        The sound and ""; None and "" for a silent video; None and why, if the movie does not show the frames at their
        own speed.
    """
    if video.sound is None:
        return None, ""
    times = np.arange(max(1, round(seconds * fps))) / fps
    shown = np.array([frame(float(time)) for time in times])
    away = shown - (shown[0] + times * video.fps)
    away -= np.round(away / video.frame_count) * video.frame_count  # loops
    if np.abs(away).max() > _STEADY:
        return None, "the movie does not show the frames at their own speed"
    return MovieSound(video.sound, shown[0] / video.fps, video.duration), ""
