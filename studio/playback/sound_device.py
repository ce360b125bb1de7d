"""The computer's audio output, through PortAudio."""

import time
from typing import Any

from studio.errors import StudioError
from studio.playback.sound_player import FillFn


class SoundDevice:
    """The default output device; see `Output`."""

    def __init__(self) -> None:
        self._stream: Any = None

    def start(self, sample_rate: int, channels: int, fill: FillFn) -> None:
        """See `Output.start`; StudioError (`sound.unavailable`) if PortAudio or an output device is missing."""
        sounddevice = _sounddevice()

        def callback(out: Any, frames: int, times: Any, status: Any) -> None:
            # Not all systems tell when a block will be heard; then the latency of the stream has to do.
            ahead = times.outputBufferDacTime - times.currentTime
            fill(out, time.monotonic() + (ahead if 0 < ahead < 1 else self._stream.latency))

        try:
            self._stream = sounddevice.OutputStream(
                samplerate=sample_rate, channels=channels, dtype="float32", callback=callback
            )
            self._stream.start()
        except (sounddevice.PortAudioError, ValueError, OSError) as error:
            self.stop()
            problem = f"no audio output device ({error})"
            raise StudioError("sound.unavailable", problem, fix="Connect one, then open the stream again.") from None

    def stop(self) -> None:
        stream, self._stream = self._stream, None
        if stream is not None:
            stream.close()

    def now(self) -> float:
        return time.monotonic()


def _sounddevice() -> Any:
    try:
        import sounddevice
    except ImportError:
        problem = "the package sounddevice is missing"
        raise StudioError("sound.unavailable", problem, fix="Install it: pip install sounddevice.") from None
    except OSError:  # the package is there, the library is not
        problem = "PortAudio is missing"
        raise StudioError("sound.unavailable", problem, fix="Install it: apt install libportaudio2.") from None
    return sounddevice
