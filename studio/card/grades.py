"""The card as data: checks with their grades."""

from typing import Literal, TypeAlias

from pydantic import BaseModel, ConfigDict

Grade: TypeAlias = Literal["good", "doubtful", "wrong", "not enough to judge"]


class Check(BaseModel):
    """One line of the card. `causes`: kinds of the mistakes that explain what does not fit, such as "inverted"."""

    model_config = ConfigDict(frozen=True)

    name: Literal["time", "cameras", "masks", "color"]
    grade: Grade
    words: str  # one or two sentences with the figure
    fix: str = ""
    causes: tuple[str, ...] = ()
    cameras: tuple[str, ...] = ()  # those that are off

    @property
    def line(self) -> str:
        return " ".join(filter(None, [f"{self.name}: {self.grade}.", self.words, self.fix]))


class Card(BaseModel):
    """All checks, and the lag of each camera in frames, as far as it is known."""

    model_config = ConfigDict(frozen=True)

    checks: tuple[Check, ...]
    late: dict[str, float] = {}
    frames: tuple[int, ...] = ()

    @property
    def is_wrong(self) -> bool:
        return any(check.grade == "wrong" for check in self.checks)

    @property
    def lines(self) -> list[str]:
        return [check.line for check in self.checks]

    @property
    def grades(self) -> str:
        """All grades in one line."""
        return "; ".join(f"{check.name}: {check.grade}" for check in self.checks)
