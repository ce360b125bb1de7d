"""Defaults are the recorded ones."""

from __future__ import annotations

from studio.meshing.settings import InitializeSettings
from tests.support.default_settings import defaults, recorded


def test_defaults() -> None:
    found, record = defaults(InitializeSettings), recorded("initialize")
    assert found == {name: record[name] for name in found}
