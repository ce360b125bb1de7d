"""The log of the window's state, as a program that drives the window reads it."""

from __future__ import annotations

from pathlib import Path

from gui.state import StateLog


def test_ticks_can_be_read_before_the_first_one(tmp_path: Path) -> None:
    """The first state is written before its tick is counted: whoever has read that state reads the ticks next."""
    log = StateLog(tmp_path / "log")
    ticks = tmp_path / "log.ticks"
    assert int(ticks.read_bytes()) == 0
    log.tick()
    log.tick()
    assert int(ticks.read_bytes()) == 2
    log.close()
