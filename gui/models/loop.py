"""What happens on the window's thread: callbacks that other threads post, timers, and signals by which models notify.

A model changes only on this thread. A worker's result, or a line of a child process, is posted; the model takes it in
and emits a signal; widgets and actions that show the model are connected to that signal.
"""

import time
import weakref
from collections import deque
from collections.abc import Callable
from functools import partial
from typing import Generic, ParamSpec

Arguments = ParamSpec("Arguments")
Callback = Callable[[], object]


class Signal(Generic[Arguments]):
    """Calls what is connected to it."""

    def __init__(self) -> None:
        self._receivers: list[Callable[Arguments, object]] = []

    def connect(self, receiver: Callable[Arguments, object]) -> None:
        """Call `receiver` each time the signal is emitted."""
        self._receivers.append(receiver)

    def emit(self, *args: Arguments.args, **kwargs: Arguments.kwargs) -> None:
        """Call all receivers, in the order in which they were connected."""
        for receiver in self._receivers:
            receiver(*args, **kwargs)


class Timer:
    """Calls a bound method every so often, as long as its object exists: only a weak reference is kept."""

    def __init__(self, seconds: float, method: Callback) -> None:
        self._seconds, self._method = seconds, weakref.WeakMethod(method)
        self._due = 0.0

    def soon(self) -> None:
        """Call the method at the next run of the loop."""
        self._due = 0.0

    def run(self) -> bool:
        """Call the method if it is due; returns whether the timer is still needed."""
        method = self._method()
        if method is not None and time.monotonic() >= self._due:
            self._due = time.monotonic() + self._seconds
            method()
        return method is not None


class Loop:
    """See the module. The window runs it at each tick."""

    def __init__(self) -> None:
        self._posted: deque[Callback] = deque()
        self._timers: list[Timer] = []

    def post(self, callback: Callback) -> None:
        """Call `callback` at the next run. Thread-safe."""
        self._posted.append(callback)

    def every(self, seconds: float, method: Callback) -> Timer:
        """Call a bound method at the next run and then once per period; see `Timer`."""
        timer = Timer(seconds, method)
        self._timers.append(timer)
        return timer

    def stop(self) -> None:
        """End all timers."""
        self._timers.clear()

    def run(self) -> None:
        """Call what is posted and due. What a callback raises comes out; the rest is called at the next run."""
        while self._posted:
            self._posted.popleft()()
        for timer in list(self._timers):
            if not timer.run():
                self._timers.remove(timer)


LOOP = Loop()  # the loop of the window's thread


def later(receiver: Callable[Arguments, object]) -> Callable[Arguments, None]:
    """A receiver called at the next run of the loop: the toolkit emits while it draws, when no dialog may be opened."""

    def post(*args: Arguments.args, **kwargs: Arguments.kwargs) -> None:
        LOOP.post(partial(receiver, *args, **kwargs))

    return post
