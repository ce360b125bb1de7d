"""Defaults of all settings are the recorded ones.

A changed default changes what users get from the same configuration, and makes their takes stale: change it in
tests/data/default_settings.json as well, and describe it in CHANGELOG.md.
"""

import json
from pathlib import Path

from pipelines.config import Config

RECORDED = Path(__file__).parents[2] / "data" / "default_settings.json"


def test_all_sections_have_the_recorded_defaults() -> None:
    recorded = json.loads(RECORDED.read_text(encoding="utf-8"))
    for section, found in Config().model_dump(mode="json").items():
        assert found == recorded[section], section
