"""The sound of the open stream or cast: fetched and measured on a thread of its own, then played."""

import contextlib
import threading

import numpy as np

from v3studio.gui.drawing.palette import SECOND
from v3studio.gui.models.playback.stream_source import StreamSource
from v3studio.gui.models.playback.timeline_plots import Waveform
from v3studio.pipelines.share.cast_frames import CastFrames
from v3studio.studio.audio import Pcm
from v3studio.studio.audio.pcm import part_of
from v3studio.studio.errors import StudioError
from v3studio.studio.playback import SoundDevice, SoundPlayer

PEAKS = 4096  # parts of a waveform, more than a timeline has columns


class StreamAudio:
    """The sound of a stream. Its thread sets each attribute at once: `player` and `waveform` (for the timeline) are
    None until they are loaded. Frames are counted as in the source; those before a take's in point are silent."""

    def __init__(self, source: StreamSource | CastFrames, output: SoundDevice) -> None:
        self.frame_count, self.fps = source.frame_count, source.fps
        self.player: SoundPlayer | None = None
        self.waveform: Waveform | None = None
        self._source, self._output = source, output
        self._error = ""
        self._volume = 1.0
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._load, name="v3studio sound", daemon=True)
        self._thread.start()

    @property
    def message(self) -> str:
        """Return why nothing is heard; "" if it works, as far as known."""
        return self._error or (self.player.message if self.player is not None else "")

    @property
    def volume(self) -> float:
        """0 (off) to 1."""
        return self._volume

    @volume.setter
    def volume(self, value: float) -> None:
        self._volume = value
        if self.player is not None:
            self.player.volume = value

    def close(self) -> None:
        """Stop, and release the device. Call it before closing the source."""
        self._closed.set()
        if self.player is not None:
            self.player.close()

    def _load(self) -> None:
        try:
            with contextlib.ExitStack() as stack:
                sound = self._source.sound()
                if sound is None:
                    return
                stack.callback(sound.close)
                seconds, early = self.frame_count / self.fps, self._source.first / self.fps
                player = SoundPlayer(part_of(sound, -early, seconds), seconds, self._output)
                stack.callback(player.close)
                player.volume = self._volume
                if self._closed.is_set():
                    return
                self.player = player
                measured = sound.copy()  # so that playing and measuring do not seek in turn
                stack.callback(measured.close)
                peaks = peaks_of(part_of(measured, -early, seconds), seconds, self._closed)
                if peaks is not None:
                    self.waveform = Waveform("Sound", (), SECOND, "", peaks=peaks)
                self._closed.wait()
        except StudioError as error:
            self._error = f"{error} Playing without sound."


def peaks_of(sound: Pcm, seconds: float, stop: threading.Event) -> np.ndarray | None:
    """The lowest and highest sample, (N, 2) float32, in at most `PEAKS` equal parts of `seconds`; None if stopped."""
    total = max(round(seconds * sound.sample_rate), 1)
    edges = np.linspace(0, total, min(PEAKS, total) + 1).astype(int)
    peaks = np.zeros((len(edges) - 1, 2), np.float32)
    step = max(sound.sample_rate * len(peaks) // total, 1)  # about a second at once
    for start in range(0, len(peaks), step):
        if stop.is_set():
            return None
        end = min(start + step, len(peaks))
        block = sound.read(int(edges[start]), int(edges[end] - edges[start]))
        starts = edges[start:end] - edges[start]
        peaks[start:end, 0] = np.minimum.reduceat(block.min(axis=1), starts)
        peaks[start:end, 1] = np.maximum.reduceat(block.max(axis=1), starts)
    return peaks
