"""The published schemas are current; to update them, run scripts/result_schemas.py."""

import importlib.util
import json
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
spec = importlib.util.spec_from_file_location("result_schemas", ROOT / "scripts" / "result_schemas.py")
assert spec is not None
assert spec.loader is not None
script = importlib.util.module_from_spec(spec)
spec.loader.exec_module(script)


@pytest.mark.parametrize("name", script.MODELS)
def test_the_published_schema_is_current(name: str) -> None:
    assert json.loads((ROOT / "docs" / name).read_text()) == script.schema(script.MODELS[name])
