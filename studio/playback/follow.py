"""Follows a live stream: reads its manifest again until it is complete."""

import threading
from collections.abc import Callable

from studio.errors import StudioError
from studio.stream import SourceUnavailable, StreamReader

SHORTEST, LONGEST = 0.5, 5.0  # seconds between two reads; in between, about the duration of a group


class Follower:
    """A thread that refreshes a reader until its stream is no longer live. It does nothing for other streams.

    `grown` is called after new groups were found, and when the stream is complete; `lost` with the error if the stream
    was replaced by another one; nothing follows. An unreachable server or a file that is just being replaced is tried
    again.
    """

    def __init__(
        self, reader: StreamReader, grown: Callable[[], None], lost: Callable[[StudioError], None] = lambda error: None
    ) -> None:
        self._reader, self._grown, self._lost = reader, grown, lost
        self._closed = threading.Event()
        self._thread: threading.Thread | None = None
        if reader.live:
            self._thread = threading.Thread(target=self._work, name="playback-follow", daemon=True)
            self._thread.start()

    def _work(self) -> None:
        reader = self._reader
        while reader.live:
            pause = min(max(reader.frame_count / reader.fps / len(reader.index), SHORTEST), LONGEST)
            if self._closed.wait(pause):
                return
            try:
                if reader.refresh() or not reader.live:
                    self._grown()
            except SourceUnavailable:
                continue
            except StudioError as error:
                if error.code == "stream.live_changed":
                    self._lost(error)
                    return

    def close(self) -> None:
        """End the thread; does not wait for a read that hangs."""
        self._closed.set()
        if self._thread is not None:
            self._thread.join(1.0)
