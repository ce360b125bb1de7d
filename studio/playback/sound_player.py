"""Plays the sound of a stream on the computer's audio output and tells what is heard now, which the frames follow."""

import math
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Any

import numpy as np

from v3studio.studio.audio import Pcm
from v3studio.studio.errors import StudioError

FillFn = Callable[[np.ndarray, float], None]
"""Fills a block, (n, channels) float32, that will be heard from the given time on (seconds of `SoundDevice.now`)."""

_AHEAD = 0.5  # seconds that are decoded ahead of what the device has asked for
_BLOCK = 0.1  # seconds that are decoded at once
_IDLE = 1.0  # seconds after which a device that plays nothing is released
_LOST = 1.0  # seconds without a request after which a device counts as lost
_FOREVER = 1 << 62  # samples
_KEPT = 64  # requests that are remembered, more than a device has in its buffers


class SoundDevice:
    """The default output device, through PortAudio, which asks for samples on a thread of its own."""

    def __init__(self) -> None:
        self._stream: Any = None

    def start(self, sample_rate: int, channels: int, fill: FillFn) -> None:
        """Begin to call `fill`; StudioError (`sound.unavailable`) if PortAudio or an output device is missing."""
        try:
            import sounddevice
        except OSError:
            problem = "PortAudio is missing"
            raise StudioError("sound.unavailable", problem, fix="Install it: apt install libportaudio2.") from None

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
        """Release the device; no call of `fill` is in progress afterwards."""
        stream, self._stream = self._stream, None
        if stream is not None:
            stream.close()

    def now(self) -> float:
        """A clock in seconds that never runs backward."""
        return time.monotonic()


class SoundPlayer:
    """Plays a sound, whose sample 0 is heard with frame 0, on an output device; frames follow it while they play at
    their own speed. Thread safe; no method waits for the device.

    A device that cannot be opened, or that is lost (a headset that is unplugged), makes the sound silent: `message`
    says why, `position` is None, and anyone who asks for it falls back to another clock. `seconds`: duration of the
    frames, at which the sound starts over if it loops.
    """

    def __init__(self, sound: Pcm, seconds: float, output: SoundDevice) -> None:
        self._sound, self._seconds, self._output = sound, seconds, output
        self._changed = threading.Condition()
        self._thread: threading.Thread | None = None
        self._closed = False
        self._open = False  # the device
        self._playing = False
        self._loop = False
        self._take = 0  # counts calls of `play`, so that what was decoded for an earlier one is dropped
        self._start = 0  # first sample of this take; samples count on through loops
        self._next = 0  # next sample to decode
        self._queue: deque[tuple[int, np.ndarray]] = deque()
        self.queued = 0  # samples that are decoded and not yet passed to the device
        self._heard: deque[tuple[float, int, int]] = deque(maxlen=_KEPT)  # time, first sample, samples
        self._reached = 0.0
        self._asked_at = 0.0
        self.volume = 1.0  # 0, silent, to 1
        self.message = ""

    # Controls

    def play(self, seconds: float, loop: bool) -> None:
        """Play from a time of the stream on; times beyond its end are in a later loop."""
        with self._changed:
            if self._closed or self.message:
                return
            self._take += 1
            self._playing, self._loop = True, loop
            self._start = self._next = round(seconds * self._sound.sample_rate)
            self._reached = self._start / self._sound.sample_rate
            self._queue.clear()
            self._heard.clear()
            self.queued = 0
            self._asked_at = self._output.now() if self._open else math.inf  # opening takes its time
            if self._thread is None:
                self._thread = threading.Thread(target=self._run, name="sound", daemon=True)
                self._thread.start()
            self._changed.notify_all()

    def stop(self) -> None:
        """Be silent."""
        with self._changed:
            self._playing = False
            self._queue.clear()
            self.queued = 0
            self._changed.notify_all()

    # State

    def position(self) -> float | None:
        """Time of the stream that is heard now, in seconds, counted on through loops; never decreases while playing.

        None: nothing plays, or there is no device.
        """
        with self._changed:
            if not self._playing or self.message:
                return None
            now = self._output.now()
            if now - self._asked_at > _LOST:
                self._give_up("The audio device has stopped; playing without sound.")
                return None
            rate = self._sound.sample_rate
            for heard_at, first, count in reversed(self._heard):
                if heard_at <= now:
                    self._reached = max(self._reached, (first + min((now - heard_at) * rate, count)) / rate)
                    break
            return self._reached

    def close(self) -> None:
        """Release the device."""
        with self._changed:
            self._closed, self._playing = True, False
            self._changed.notify_all()
            thread = self._thread
        if thread is not None:
            thread.join()

    # The device's thread

    def _fill(self, out: np.ndarray, heard_at: float) -> None:
        out[:] = 0
        with self._changed:
            if not self._playing:
                return
            self._asked_at = self._output.now()
            filled = 0
            while filled < len(out) and self._queue:
                first, samples = self._queue.popleft()
                count = min(len(samples), len(out) - filled)
                out[filled : filled + count] = samples[:count]
                self._heard.append((heard_at + filled / self._sound.sample_rate, first, count))
                filled += count
                if count < len(samples):
                    self._queue.appendleft((first + count, samples[count:]))
            self.queued -= filled
            self._changed.notify_all()
            out *= self.volume

    # The thread that decodes, and opens the device

    def _run(self) -> None:
        try:
            while self._step():
                pass
        except Exception as error:  # whatever it is, the frames must go on
            words = str(error) if isinstance(error, StudioError) else f"Sound failed ({error!r})."
            with self._changed:
                self._give_up(f"{words} Playing without sound.")
        finally:
            self._release()
            with self._changed:
                self._thread = None

    def _step(self) -> bool:
        """One step of the thread; False at its end."""
        with self._changed:
            if not self._playing and not self._closed:
                self._changed.wait(_IDLE if self._open else None)
            if self._closed or self.message:
                return False
            playing = self._playing
        if not playing:
            self._release()
            return True
        if not self._open:
            self._output.start(self._sound.sample_rate, self._sound.channels, self._fill)
            with self._changed:
                self._open, self._asked_at = True, self._output.now()
        self._decode()
        return True

    def _release(self) -> None:
        if self._open:
            self._output.stop()  # without the lock, since it waits for `_fill`
            with self._changed:
                self._open = False

    def _decode(self) -> None:
        """Decode one block ahead, or wait until there is room for it."""
        rate = self._sound.sample_rate
        with self._changed:
            left = self._end - self._next
            if self.queued >= _AHEAD * rate or left <= 0:
                self._changed.wait(_AHEAD)
                return
            take, first = self._take, self._next
            count = min(round(_BLOCK * rate), left)
        samples = self._read(first, count)
        with self._changed:
            if take == self._take and self._playing:
                self._queue.append((first, samples))
                self.queued += count
                self._next = first + count

    @property
    def _end(self) -> int:
        """Sample after the last one; a few more than the frames take, so that the clock passes their end."""
        return _FOREVER if self._loop else math.ceil(self._seconds * self._sound.sample_rate) + 16

    def _read(self, first: int, count: int) -> np.ndarray:
        """Samples that count on through loops."""
        if not self._loop:
            return self._sound.read(first, count)
        rate = self._sound.sample_rate
        out = np.empty((count, self._sound.channels), np.float32)
        filled = 0
        while filled < count:
            at = first + filled
            lap = int((at + 0.5) / (self._seconds * rate))
            begin, end = round(lap * self._seconds * rate), round((lap + 1) * self._seconds * rate)
            part = min(max(end - at, 1), count - filled)
            out[filled : filled + part] = self._sound.read(at - begin, part)
            filled += part
        return out

    def _give_up(self, message: str) -> None:
        self.message = message
        self._playing = False
        self._queue.clear()
        self._changed.notify_all()
