"""Tables of the stages: the order of the calibration report, and texts for the clipboard."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from v3studio.studio.capture.patterns import natural_key

CAMERA = "camera"  # title of the column of names


@dataclass(frozen=True)
class Sorting:
    """The order of a table. `column`: title of a column; "" for held-out cameras first."""

    column: str = ""
    descending: bool = False

    def clicked(self, column: str) -> Sorting:
        """The order after a click on a title: figures highest first, names lowest first; then the other way."""
        return Sorting(column, not self.descending if column == self.column else column != CAMERA)

    def order(self, names: Sequence[str], columns: Mapping[str, Sequence[str]]) -> list[int]:
        """Indices of the rows in order; those without a figure come last, equal ones stay as they are."""
        rows = list(range(len(names)))
        if self.column == CAMERA:
            return sorted(rows, key=lambda row: natural_key(names[row]), reverse=self.descending)
        if self.column not in columns:  # also of another report, which lacks it
            return rows
        figures = [_figure(words) for words in columns[self.column]]
        sign = -1.0 if self.descending else 1.0
        return sorted(rows, key=lambda row: (1, 0.0) if (value := figures[row]) is None else (0, sign * value))


def cells_text(lines: Sequence[Sequence[str]]) -> str:
    """Lines of cells with tabs between them, as spreadsheets paste them."""
    return "\n".join("\t".join(line) for line in lines) + "\n"


def _figure(words: str) -> float | None:
    try:
        return float(words.replace("\N{DEGREE SIGN}", "%").partition("%")[0])
    except ValueError:
        return None
