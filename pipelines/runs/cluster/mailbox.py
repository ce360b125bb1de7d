"""What tasks on other nodes tell the run."""

from __future__ import annotations

Letter = tuple[str, tuple[str, int, int], tuple[str, ...]]
"""What it is, the stage, group and attempt that it is about, and its content."""


class Mailbox:
    """Actor on the node of the run that collects the events of all tasks."""

    def __init__(self) -> None:
        self._letters: list[Letter] = []

    def started(self, stage: str, group: int, attempt: int, node: str, gpu: str) -> None:
        """A task has begun on a node."""
        self._letters.append(("started", (stage, group, attempt), (node, gpu)))

    def put(self, stage: str, group: int, attempt: int, line: str) -> None:
        """An event of a task, as JSON."""
        self._letters.append(("event", (stage, group, attempt), (line,)))

    def delivered(self) -> None:
        """Answers when everything that the same task sent before is here: Ray keeps the order of a sender's calls."""

    def take(self) -> list[Letter]:
        """What arrived since the last call."""
        letters, self._letters = self._letters, []
        return letters
