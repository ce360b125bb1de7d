"""The window's thread: callbacks that other threads post, timers, and signals by which models notify.

A model changes only on this thread. A worker's result, or a line of a child process, is posted; the model takes it in
and emits a signal; widgets and actions that show the model are connected to that signal.
"""

import time
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
    """Calls a function every so often."""

    def __init__(self, seconds: float, callback: Callback) -> None:
        self._seconds, self._callback = seconds, callback
        self._due = 0.0

    def soon(self) -> None:
        """Call the function at the next run of the loop."""
        self._due = 0.0

    def run(self) -> None:
        """Call the function if it is due."""
        if time.monotonic() >= self._due:
            self._due = time.monotonic() + self._seconds
            self._callback()


class Loop:
    """Calls posted callbacks and timers. The window runs it at each tick."""

    def __init__(self) -> None:
        self._posted: deque[Callback] = deque()
        self._timers: list[Timer] = []

    def post(self, callback: Callback) -> None:
        """Call `callback` at the next run. Thread-safe."""
        self._posted.append(callback)

    def every(self, seconds: float, callback: Callback) -> Timer:
        """Call `callback` at the next run and then once per period."""
        timer = Timer(seconds, callback)
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
            timer.run()


LOOP = Loop()  # the loop of the window's thread


def later(receiver: Callable[Arguments, object]) -> Callable[Arguments, None]:
    """A receiver called at the next run of the loop: the toolkit emits while it draws, when no dialog may be opened."""

    def post(*args: Arguments.args, **kwargs: Arguments.kwargs) -> None:
        LOOP.post(partial(receiver, *args, **kwargs))

    return post
