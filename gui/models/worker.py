"""LatestWorker: a thread with a single request slot. A request made while it works replaces the waiting one.

The window requests an image at every change and never blocks; the thread always works on the newest request, so a slow
renderer drops frames but does not lag.
"""

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from v3studio.gui.models.loop import LOOP

Request = TypeVar("Request")
Result = TypeVar("Result")

LONGEST = 5.0  # seconds to wait for threads to end


@dataclass(frozen=True)
class Done(Generic[Request, Result]):
    """A finished request: its result, or the error that ended it."""

    request: Request
    result: Result | None
    error: Exception | None


class LatestWorker(Generic[Request, Result]):
    """Runs `work` on a separate thread, always on the newest request; an exception becomes the result's `error`. `done`
    is called with each finished request on the window's thread; None to `take` them instead. `ended` is called
    last, on the thread."""

    def __init__(
        self,
        work: Callable[[Request], Result],
        name: str,
        done: Callable[[Done[Request, Result]], object] | None = None,
        ended: Callable[[], object] = lambda: None,
    ) -> None:
        self._work, self._done, self._ended = work, done, ended
        self._condition = threading.Condition()
        self._waiting: tuple[Request] | None = None
        self._finished: Done[Request, Result] | None = None
        self._busy = False
        self.closed = False  # what is in progress may end early
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()
        _OPEN.append(self)

    def ask(self, request: Request) -> None:
        """Put a request in the slot, replacing a waiting one."""
        with self._condition:
            self._waiting = (request,)
            self._condition.notify_all()

    def take(self) -> Done[Request, Result] | None:
        """The newest finished request, returned once; None if nothing has finished since. Never blocks."""
        with self._condition:
            finished, self._finished = self._finished, None
            return finished

    @property
    def idle(self) -> bool:
        """True if nothing is waiting or in progress."""
        with self._condition:
            return self._waiting is None and not self._busy

    def close(self, seconds: float = LONGEST) -> bool:
        """Drop the waiting request and end the thread after the current one. Returns whether it ended in time."""
        with self._condition:
            self.closed = True
            self._waiting = None
            self._condition.notify_all()
        self._thread.join(seconds)
        return not self._thread.is_alive()

    def _run(self) -> None:
        while True:
            with self._condition:
                while self._waiting is None and not self.closed:
                    self._condition.wait()
                if self.closed:
                    break
                assert self._waiting is not None
                (request,) = self._waiting
                self._waiting = None
                self._busy = True
            result: Result | None = None
            failure: Exception | None = None
            try:
                result = self._work(request)
            except Exception as error:  # the window shows any error and continues
                failure = error
            with self._condition:
                self._finished = Done(request, result, failure)
                self._busy = False
                self._condition.notify_all()
            del request, result, failure  # what they hold, such as footage, is not kept until the next request
            if self._done is not None:
                LOOP.post(self._deliver)
        self._ended()

    def _deliver(self) -> None:
        finished = self.take()
        if finished is not None and self._done is not None and not self.closed:
            self._done(finished)


_OPEN: list[LatestWorker[Any, Any]] = []


def close_all() -> bool:
    """End all timers and threads, with the window. Returns whether the threads ended in time, which they share."""
    LOOP.stop()
    until = time.monotonic() + LONGEST
    for worker in _OPEN:
        worker.close(0.0)
    ended = [worker.close(max(until - time.monotonic(), 0.0)) for worker in _OPEN]
    _OPEN.clear()
    return all(ended)
