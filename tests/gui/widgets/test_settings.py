"""The settings: where a click may open a list, and the tooltips of fields that are edited."""

from __future__ import annotations

from open3d.visualization import gui

from gui.models.take.estimates import Estimates
from gui.widgets.settings import FILTER, SettingActions, SettingsList


def nothing(*_: object) -> None:
    pass


def panel_of(stage: str) -> SettingsList:
    actions = SettingActions(nothing, nothing, nothing, nothing, nothing, nothing)
    panel = SettingsList(stage, 16.0, actions, Estimates())
    panel.filter.frame = gui.Rect(10, 300, 200, 22)
    panel._scroll.frame = gui.Rect(0, 330, 290, 300)
    return panel


def test_a_field_that_is_edited_has_no_tooltip() -> None:
    """The toolkit shows it wherever the pointer is."""
    panel = panel_of("train")
    fields = [(one.widget, label) for _, one, label, _ in panel._rows.values() if isinstance(one.widget, gui.TextEdit)]
    assert fields
    panel.press(20, 310)
    assert panel.filter.tooltip == ""
    assert all(field.tooltip == label.tooltip != "" for field, label in fields)
    panel.press(100, 400)
    assert panel.filter.tooltip == FILTER
    assert all(field.tooltip == "" != label.tooltip for field, label in fields)
    panel.press(800, 400)
    assert all(field.tooltip == label.tooltip for field, label in fields)


def test_rows_that_come_while_a_field_is_edited_have_none_either() -> None:
    panel = panel_of("train")
    panel.press(100, 400)
    panel.find("iterations")
    assert panel.refilter()
    fields = [one.widget for _, one, _, _ in panel._rows.values() if isinstance(one.widget, gui.TextEdit)]
    assert fields
    assert all(field.tooltip == "" for field in fields)


def test_lists_are_known_for_the_hints() -> None:
    panel = panel_of("train")
    assert panel.preset in panel.lists
    panel.widget.visible = False
    assert panel.lists == []
