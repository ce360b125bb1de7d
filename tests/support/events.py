"""Events in what a command prints."""

import signal
from collections.abc import Callable, Iterable
from typing import Any

from v3studio.pipelines.events import Event, Metrics, Warned, read_line


def events_in(text: str) -> list[Event]:
    """The events; other tests check that a command prints nothing else."""
    return [event for event, _ in map(read_line, text.splitlines()) if event is not None]


def frames_in(events: Iterable[Event], *stages: str) -> list[int]:
    """Indices of the frames that a run trained, in its order; with `stages`, that these stages trained or measured."""
    done = [one for one in events if isinstance(one, Metrics) and one.frame is not None]
    return [one.values["index"] for one in done if one.stage in (stages or ("train",))]


def warnings_in(events: Iterable[Event], code: str) -> list[Warned]:
    """The warnings with a code."""
    return [event for event in events if isinstance(event, Warned) and event.code == code]


def trains_a_frame(event: Event) -> bool:
    """Whether a frame has been trained."""
    return frames_in([event]) != []


def stop_when(process: Any, accept: Callable[[Event], bool], number: int = signal.SIGKILL) -> list[Event]:
    """Read the events of a started command until one is accepted, then send the signal; all events until its end."""
    events: list[Event] = []
    for line in process.stdout:
        events += events_in(line)
        if events and accept(events[-1]):
            process.send_signal(number)
            break
    else:
        raise AssertionError(f"the run ended before it could be stopped: {process.stderr.read()}")
    events += events_in(process.stdout.read())
    process.wait(timeout=120)
    return events
