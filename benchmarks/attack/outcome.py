"""What one part of the attack tried and found."""

import time
from dataclasses import dataclass, field


@dataclass
class Outcome:
    """Counts attempts and collects what was wrong."""

    name: str  # the part
    promised: str  # what must hold, in a few words
    count: int = 0  # attempts
    wrong: list[str] = field(default_factory=list)  # one line per broken promise
    notes: list[str] = field(default_factory=list)  # what happened that is no fault, such as what was refused
    began: float = field(default_factory=time.monotonic)

    def failed(self, line: str) -> None:
        """Record, and print, a broken promise."""
        self.wrong.append(line)
        print(f"{self.name}: WRONG: {line}", flush=True)

    def row(self) -> str:
        """A row of a Markdown table."""
        happened = f"{len(self.wrong)} broken" if self.wrong else "kept"
        notes = "; ".join(self.notes[:3])
        return f"| {self.name} | {self.count:,} | {self.promised} | {happened}{'; ' + notes if notes else ''} |"
