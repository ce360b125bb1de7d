"""The settings on the left: headings, labels that can be told apart, and the filter."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from pathlib import Path

import pytest

from gui.presenters.run.settings import SECTIONS, fields_of, matching
from pipelines.config import load_config


@pytest.mark.parametrize("stage", SECTIONS)
def test_settings_stand_under_headings_with_labels_of_their_own(stage: str) -> None:
    fields = fields_of(stage)
    assert all(field.heading for field in fields)
    labels = [field.label for field in fields]
    assert len(set(labels)) == len(labels)
    runs = [heading for heading, _ in itertools.groupby(field.heading for field in fields)]
    assert len(set(runs)) == len(runs), "each heading once"


def test_the_filter_looks_at_names_headings_and_documentation() -> None:
    fields = fields_of("train")
    assert [field.name for field in matching(fields, "  ")] == [field.name for field in fields]
    rates = matching(fields, "learning rate splats")
    assert [field.name for field in rates] == [field.name for field in fields if field.name.startswith("train.rates.")]
    assert [field.name for field in matching(fields, "Quaternion")] == ["train.rates.rotation"]
    assert matching(fields, "quaternion nonsense") == []


def test_a_setting_is_found_and_changed_through_the_filter(
    open_window: Callable, take_copy: Path, artifacts: Path
) -> None:
    window = open_window(str(take_copy))
    window.wait_for("a take", lambda s: s["stages"]["train"][0] == "done")
    window.press_until("space", "paused", lambda s: not s["playing"])
    window.stage("train")
    window.click("settings filter")
    window.type("rates opacity")
    state = window.wait_for("one setting", lambda s: [n for n in s["widgets"] if n.startswith("setting ")] == FOUND)
    assert state["stage"] == "train", "letters in the field are no shortcuts"
    window.screenshot(artifacts / "settings_filter.png")
    window.retype(FOUND[0], "0.025")
    window.wait_for("a stale training", lambda s: s["stages"]["train"][0] != "done")
    assert load_config(take_copy / "config.yaml").train.rates.opacity == 0.025
    window.click("settings filter", 0.9)
    for _ in range(13):
        window.key("BackSpace")
    window.wait_for("all of them", lambda s: len([n for n in s["widgets"] if n.startswith("setting ")]) > 40)
    assert window.close() == 0, window.stderr.read_text()[-2000:]


FOUND = ["setting train.rates.opacity"]
