"""Events in what a command prints."""

from typing import Any

from pipelines.events import Event, Finished, parse_event, read_line


def events_in(text: str) -> list[Event]:
    """The events; other tests check that a command prints nothing else."""
    return [event for event, _ in map(read_line, text.splitlines()) if event is not None]


def end_of(output: str | bytes) -> Finished:
    """The last event of a command with `--json`, from what it printed."""
    text = output if isinstance(output, str) else output.decode("utf-8")
    last = parse_event(text.splitlines()[-1])
    assert isinstance(last, Finished)
    return last


def result_of(output: str | bytes) -> Any:
    """Its result."""
    return end_of(output).result
