"""Events in what a command prints."""

from pipelines.events import Event, read_line


def events_in(text: str) -> list[Event]:
    """The events; other tests check that a command prints nothing else."""
    return [event for event, _ in map(read_line, text.splitlines()) if event is not None]
