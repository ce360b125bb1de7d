"""A press of a key does one thing, however often the toolkit reports it."""

from __future__ import annotations

from gui.platform.key_reports import SETTLED, KeyReports


def ticked(reports: KeyReports, count: int) -> KeyReports:
    for _ in range(count):
        reports.tick()
    return reports


def test_a_press_that_is_reported_twice_counts_once() -> None:
    reports = KeyReports()
    reports.press()
    assert [reports.is_new(), reports.is_new(), ticked(reports, 5).is_new()] == [True, False, False]
    reports.press()
    assert reports.is_new(), "the next press is another one"
    assert (reports.passed, reports.again) == (2, 2)


def test_presses_and_repeats_in_a_row_count_each() -> None:
    reports = KeyReports()
    for _ in range(3):
        reports.press()
    assert [reports.is_new() for _ in range(4)] == [True, True, True, False]


def test_what_a_text_field_kept_is_forgotten() -> None:
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
