import importlib
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).parents[2]
Load = Callable[[str], ModuleType]


@pytest.fixture
def generator(monkeypatch: pytest.MonkeyPatch) -> Iterator[Load]:
    """Imports one of the modules in docs/generate, which is no installed package."""
    monkeypatch.syspath_prepend(str(ROOT / "docs"))
    yield lambda name: importlib.import_module(f"generate.{name}")
    for name in [name for name in sys.modules if name.split(".")[0] == "generate"]:
        del sys.modules[name]


def test_error_codes_are_found_with_their_text(generator: Load) -> None:
    source = (
        'raise StudioError("footage.no_frames", f"camera {camera.name} has no frames", fix="Add " + "frames.")\n'
        'Message("stream.old", "version 1")\n'
        'AGAIN = "Copy it again."\n'
        'raise StudioError("footage.damaged", f"{len(left)} of {join(names)} in {LIMITS[0]}", fix=AGAIN)\n'
        'problem = f"rendition {name}: {problem}"\n'
        'refusal = StudioError("bake.refused", problem)\n'
        'problem = "another"\n'
        'raise StudioError("an old sentence without a code")\n'
        'raise KeyError("not.ours")\n'
        'print("footage.printed", "nothing")\n'
    )
    sites = {site.code: site for site in generator("errors").sites(source)}
    assert set(sites) == {"footage.no_frames", "stream.old", "footage.damaged", "bake.refused"}
    assert sites["bake.refused"].problem == "rendition *name*: *problem*"
    assert sites["footage.damaged"].problem == "*n* of *names* in *LIMITS*"
    assert sites["footage.damaged"].fix == "Copy it again."
    assert sites["footage.no_frames"].problem == "camera *name* has no frames"
    assert sites["footage.no_frames"].fix == "Add frames."


def test_fields_of_events_have_a_meaning_and_a_type_of_json(generator: Load) -> None:
    page = generator("events").events_page()
    rows = [line.strip("| ").split(" | ") for line in page.splitlines() if line.startswith("| `")]
    kinds = {"string", "number", "integer", "boolean", "object", "array", "any"}
    assert {kind for row in rows for kind in row[1].split(" or ")} == {*kinds, "null"}
    assert {len(row) for row in rows} == {3}


def test_names_that_do_not_exist_are_found(generator: Load) -> None:
    text = "`studio/cameras.py`, `studio/gone.py`, `train.gone`, `capture.masks: none`, `numpy.array`\n"
    text += "```\n`studio/x`\n```"
    unknown = list(generator("names").unknown_names(text, ROOT, {"train", "capture", "capture.masks"}))
    assert unknown == ["studio/gone.py: no such file", "train.gone: no such setting"]
