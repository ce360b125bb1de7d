"""A look is repeated for another key, and when what it found is old."""

from __future__ import annotations

from gui.models.ttl_cache import TtlCache


def test_a_look_is_repeated_for_another_key_and_when_it_is_old() -> None:
    looks: list[str] = []
    clock = [0.0]

    def look(key: str) -> int:
        looks.append(key)
        return len(looks)

    remembered = TtlCache(look, 0.5, lambda: clock[0])
    assert [remembered.get("a"), remembered.get("a")] == [1, 1]
    clock[0] = 0.4
    assert remembered.get("a") == 1
    clock[0] = 0.5
    assert remembered.get("a") == 2
    assert remembered.get("b") == 3
    assert remembered.get("a") == 4
    assert looks == ["a", "a", "b", "a"]
