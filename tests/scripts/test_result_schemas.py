"""The published schemas are current; to update them, run scripts/result_schemas.py."""

import json

import pytest

from scripts import result_schemas as script
from tests.support.tiny_capture import ROOT


@pytest.mark.parametrize("name", script.MODELS)
def test_the_published_schema_is_current(name: str) -> None:
    assert json.loads((ROOT / "docs" / name).read_text()) == script.schema(script.MODELS[name])
