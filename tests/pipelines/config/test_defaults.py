"""Defaults of the sections that belong to runs and reports."""

from __future__ import annotations

from pipelines.config import Config
from tests.support.default_settings import recorded


def test_all_sections_have_the_recorded_defaults() -> None:
    found = Config().model_dump(mode="json")
    for section in found:
        assert found[section] == recorded(section), section
