"""Items of the menus are gray while they are not possible."""

from __future__ import annotations

from gui.actions.menus import ITEMS, MenuStates

KEYS = list(ITEMS)


class Bar:
    """What is told to the toolkit."""

    def __init__(self) -> None:
        self.told: list[tuple[int, bool]] = []

    def set_enabled(self, number: int, on: bool) -> None:
        self.told.append((number, on))


def test_only_changes_are_passed_on() -> None:
    reasons = {"undo": "nothing to undo"}
    states, bar = MenuStates(lambda item: reasons.get(item.key, "")), Bar()
    undo = KEYS.index("undo") + 1
    assert not states.update(None)
    assert states.update(bar)  # type: ignore[arg-type]
    assert bar.told == [(undo, False)], "items are possible at first"
    reasons.clear()
    assert states.update(bar)  # type: ignore[arg-type]
    assert bar.told == [(undo, False), (undo, True)]
    assert not states.update(bar)  # type: ignore[arg-type]
