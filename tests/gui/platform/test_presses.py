"""A press of a key does one thing, however often the toolkit reports it."""

from __future__ import annotations

from typing import TypeVar

from gui.platform.presses import PATIENCE, SETTLED, Escapes, KeyReports

Presses = TypeVar("Presses", Escapes, KeyReports)


def ticked(presses: Presses, count: int) -> Presses:
    for _ in range(count):
        presses.tick()
    return presses


def test_a_press_that_is_reported_twice_counts_once() -> None:
    escapes = Escapes()
    escapes.pressed()
    assert escapes.heard(again=False)
    assert not escapes.heard(again=True), "while it is held"
    assert not escapes.heard(again=False), "even if a release was reported in between"
    ticked(escapes, 100)
    escapes.released()
    assert not escapes.heard(again=False), "and when it is released"
    assert not ticked(escapes, 2 * PATIENCE).kept(), "it has been reported"


def test_presses_in_a_row_count_each() -> None:
    escapes = Escapes()
    for _ in range(2):
        escapes.pressed()
        escapes.released()
    assert [escapes.heard(again=False), escapes.heard(again=False), escapes.heard(again=False)] == [True, True, False]


def in_a_dialog() -> Escapes:
    escapes = Escapes()
    escapes.dialog = True
    return escapes


def test_a_press_that_a_text_field_kept_is_told_once() -> None:
    escapes = in_a_dialog()
    escapes.pressed()
    assert not ticked(escapes, PATIENCE - 1).kept()
    assert ticked(escapes, 1).kept()
    assert not ticked(escapes, 5).kept()
    assert not escapes.heard(again=False), "a report that comes late is of the same press"
    escapes.pressed()
    assert escapes.heard(again=False), "the next press is another one"


def test_presses_in_a_row_that_a_text_field_kept_are_told_each() -> None:
    escapes = in_a_dialog()
    for _ in range(2):
        escapes.pressed()
        escapes.released()
        ticked(escapes, 3)
    ticked(escapes, PATIENCE)
    assert [escapes.kept(), escapes.kept(), escapes.kept()] == [True, True, False]


def test_a_late_report_counts_where_no_dialog_is_open() -> None:
    escapes = Escapes()
    escapes.pressed()
    assert not ticked(escapes, PATIENCE + 5).kept(), "nobody would act on it"
    assert escapes.heard(again=False)
    assert not escapes.heard(again=False), "once"


def test_a_press_before_a_dialog_opens_does_not_close_it() -> None:
    """As one that the field for searching settings has kept."""
    escapes = Escapes()
    escapes.pressed()
    ticked(escapes, PATIENCE)
    escapes.dialog = True
    assert not ticked(escapes, PATIENCE).kept()
    escapes.pressed()
    assert ticked(escapes, PATIENCE).kept(), "this one is of the dialog"
    assert not ticked(escapes, PATIENCE).kept()


def test_a_press_that_nothing_told_of_is_forgotten() -> None:
    escapes = Escapes()
    escapes.pressed()
    ticked(escapes, SETTLED)
    escapes.pressed()
    assert [escapes.heard(again=False), escapes.heard(again=False)] == [True, False]


def test_presses_that_come_another_way_count_but_not_their_repeats() -> None:
    escapes = Escapes()
    assert escapes.heard(again=False)
    assert not escapes.heard(again=True)
    escapes.pressed()
    escapes.heard(again=False)
    escapes.released()
    assert ticked(escapes, SETTLED).heard(again=False), "the pointer has left the window since"


def test_a_key_that_is_reported_twice_counts_once() -> None:
    reports = KeyReports()
    reports.press()
    assert [reports.is_new(), reports.is_new(), ticked(reports, 5).is_new()] == [True, False, False]
    reports.press()
    assert reports.is_new(), "the next press is another one"
    assert (reports.passed, reports.again) == (2, 2)


def test_keys_and_repeats_in_a_row_count_each() -> None:
    reports = KeyReports()
    for _ in range(3):
        reports.press()
    assert [reports.is_new() for _ in range(4)] == [True, True, True, False]


def test_a_key_that_a_text_field_kept_is_forgotten() -> None:
    reports = KeyReports()
    reports.press()
    ticked(reports, SETTLED - 1)
    reports.press()
    ticked(reports, 1)
    assert [reports.is_new(), reports.is_new()] == [True, False]


def test_presses_that_do_not_come_through_count_each() -> None:
    reports = KeyReports()
    assert [reports.is_new(), reports.is_new()] == [True, True]
    reports.press()
    assert reports.is_new()
    ticked(reports, SETTLED)
    assert [reports.is_new(), reports.is_new()] == [True, True], "the pointer has left the window since"


def test_a_report_that_comes_late_counts() -> None:
    reports = KeyReports()
    reports.press()
    assert ticked(reports, 10 * SETTLED).is_new(), "drawing took long"
