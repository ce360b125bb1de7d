"""Follows a live stream: reads its manifest again until it is complete."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager

from v3studio.studio.errors import StudioError
from v3studio.studio.stream import SourceUnavailable, StreamReader

SHORTEST, LONGEST = 0.5, 5.0  # seconds between two reads; in between, about the duration of a group


@contextmanager
def following(reader: StreamReader) -> Iterator[list[StudioError]]:
    """Refresh a reader on a thread, until its stream is no longer live; other streams stay as they are.

    The list gets the error if the stream is replaced by another one, which is not followed. An unreachable server or a
    file that is just being replaced is tried again.
    """
    closed = threading.Event()
    lost: list[StudioError] = []

    def work() -> None:
        while reader.live:
            pause = min(max(reader.frame_count / reader.fps / len(reader.index), SHORTEST), LONGEST)
            if closed.wait(pause):
                return
            try:
                reader.refresh()
            except SourceUnavailable:
                continue
            except StudioError as error:
                if error.code == "stream.live_changed":
                    lost.append(error)
                    return

    thread = threading.Thread(target=work, name="playback-follow", daemon=True)
    thread.start()
    try:
        yield lost
    finally:
        closed.set()
        thread.join(1.0)  # a read may hang
