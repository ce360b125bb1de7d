"""Defaults are the recorded ones."""

from __future__ import annotations

from studio.calibration.settings import CalibrateSettings
from tests.support.default_settings import defaults, recorded


def test_defaults() -> None:
    found, record = defaults(CalibrateSettings), recorded("calibrate")
    assert found == {name: record[name] for name in found}
