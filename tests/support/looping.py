"""Waiting while the window's loop runs, as it does at each tick of the window."""

from collections.abc import Callable

from tests.support.waiting import wait_until
from v3studio.gui.models.loop import LOOP, Signal


def wait_in_loop(what: str, accept: Callable[[], object], seconds: float = 120.0) -> None:
    """Run the loop until `accept` is true; fail after some seconds."""

    def accepted() -> bool:
        LOOP.run()
        return bool(accept())

    wait_until(what, accepted, seconds)


def heard(signal: Signal[...]) -> list[tuple[object, ...]]:
    """The arguments of each time that a signal is emitted from now on."""
    found: list[tuple[object, ...]] = []
    signal.connect(lambda *of: found.append(of))
    return found
