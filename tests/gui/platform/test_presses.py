"""Presses of keys whose reports the toolkit loses or doubles."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from open3d.visualization import gui

from gui.platform.keyboard import KEYS
from gui.platform.presses import SETTLED, Chords, KeyReports, Press, key_code

KEY, CONTROL = gui.KeyName, gui.KeyName.LEFT_CONTROL
K = KEYS["k"]


def event(key: gui.KeyName, down: bool = True) -> gui.KeyEvent:
    kind = gui.KeyEvent.Type
    return SimpleNamespace(key=key, type=kind.DOWN if down else kind.UP)  # type: ignore[return-value]


@pytest.mark.parametrize(("key", "code"), [(KEY.K, 45), (KEY.ONE, 10), (KEY.LEFT_CONTROL, 37), (KEY.F5, None)])
def test_places_of_keys(key: gui.KeyName, code: int | None) -> None:
    assert key_code(key) == code


def test_a_chord_counts_again_although_the_toolkit_lost_its_release() -> None:
    chords = Chords()
    assert chords.note(event(CONTROL), Press(37))
    assert not chords.note(event(KEY.K), Press(K, control=True))
    assert chords.control
    assert not chords.again
    # both are released while a dialog opens
    chords.note(event(KEY.K), Press(K, control=True))
    assert chords.control
    assert not chords.again
    chords.note(event(KEY.K), Press(K))
    assert not chords.control, "Ctrl is up, whatever the toolkit has reported"


def test_a_key_that_is_held_repeats() -> None:
    chords = Chords()
    for press in (Press(K), None):
        chords.note(event(KEY.K), press)
        assert not chords.again
        chords.note(event(KEY.K), press and press._replace(repeated=True))
        assert chords.again
        chords.note(event(KEY.K, down=False))


def test_a_report_belongs_to_the_press_of_its_own_key() -> None:
    reports = KeyReports()
    kept, shift_k, k = Press(38), Press(K, shift=True), Press(K)
    for press in (kept, shift_k, k):
        reports.press(press)
    assert reports.reported(K) == (True, shift_k)
    assert reports.reported(38) == (False, None), "a text field has kept that one"
    assert reports.reported(K) == (True, k)
    assert reports.reported(K) == (False, None), "one press is acted on once"
    assert reports.again == 2
    for _ in range(SETTLED):
        reports.tick()
    assert reports.reported(K) == (True, None), "with the pointer outside of the window"
