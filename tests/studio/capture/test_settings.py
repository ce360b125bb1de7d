"""Defaults are the recorded ones."""

from __future__ import annotations

from studio.capture.settings import CaptureSettings
from tests.support.default_settings import defaults, recorded


def test_defaults() -> None:
    found, record = defaults(CaptureSettings), recorded("capture")
    assert found == {name: record[name] for name in found}
