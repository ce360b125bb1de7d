"""The terminal, its tables, and durations as text."""

from __future__ import annotations

import os
import sys
from typing import TYPE_CHECKING, Any

from v3studio.studio.errors import visible

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table


def say(text: str, *, error: bool = False) -> None:
    """Print text for people, made `visible`, to standard output or standard error."""
    print(visible(text), file=sys.stderr if error else sys.stdout, flush=True)


def console() -> Console:
    """A rich console as wide as the terminal, 120 columns if there is none, that prints text made `visible`."""
    from rich.console import Console

    class Screen(Console):
        def print(self, *objects: Any, **options: Any) -> None:
            super().print(*(visible(item) if isinstance(item, str) else item for item in objects), **options)

    return Screen(highlight=False, width=None if sys.stdout.isatty() or "COLUMNS" in os.environ else 120)


def table_of(*columns: str, left: tuple[int, ...] = ()) -> Table:
    """An empty table; columns are right-aligned, except those whose index is in `left`."""
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for number, column in enumerate(columns):
        table.add_column(column, justify="left" if number in left else "right")
    return table


def escaped(text: str) -> str:
    """Text made `visible`, with rich's markup escaped."""
    from rich.markup import escape

    return escape(visible(text))


def duration(seconds: float) -> str:
    """Seconds as "12 s", "3 min 05 s" or "2 h 07 min"."""
    if seconds < 60:
        return f"{seconds:.1f} s" if seconds < 10 else f"{seconds:.0f} s"
    whole = round(seconds)
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02d} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02d} min"
