"""The recorded defaults of settings.

A changed default changes what users get from the same configuration, and makes their takes stale: change it in
tests/data/default_settings.json as well, and tell it in CHANGELOG.md.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from studio.settings import Settings

RECORDED = Path(__file__).parents[1] / "data" / "default_settings.json"


def recorded(section: str) -> Any:
    """JSON-ready values by name."""
    return json.loads(RECORDED.read_text(encoding="utf-8"))[section]


def defaults(settings: type[Settings]) -> dict[str, Any]:
    """JSON-ready values by name, of settings that are made without an argument."""
    return settings().model_dump(mode="json")
