"""Defaults are the recorded ones."""

from __future__ import annotations

from studio.training.settings import TrainSettings
from tests.support.default_settings import defaults, recorded


def test_defaults() -> None:
    found, record = defaults(TrainSettings), recorded("train")
    assert found == {name: record[name] for name in found}
