"""The generated pages of the documentation: what they find in the source."""

import importlib
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Annotated, ClassVar

import pytest
from pydantic import BaseModel, Field

ROOT = Path(__file__).parents[2]
Load = Callable[[str], ModuleType]


@pytest.fixture
def generator(monkeypatch: pytest.MonkeyPatch) -> Iterator[Load]:
    """Imports one of the modules in docs/generate, which is no installed package."""
    monkeypatch.syspath_prepend(str(ROOT / "docs"))

    def load(name: str) -> ModuleType:
        return importlib.import_module(f"generate.{name}")

    yield load
    for name in [name for name in sys.modules if name.split(".")[0] == "generate"]:
        del sys.modules[name]


def test_error_codes_are_found_with_their_text(generator: Load) -> None:
    source = (
        'raise StudioError("footage.no_frames", f"camera {camera.name} has no frames", fix="Add " + "frames.")\n'
        'Message("stream.old", "version 1")\n'
        'raise StudioError("an old sentence without a code")\n'
        'raise KeyError("not.ours")\n'
        'print("footage.printed", "nothing")\n'
    )
    found = {site.code: site for site in generator("errors").sites(source)}
    assert set(found) == {"footage.no_frames", "stream.old"}
    assert found["footage.no_frames"].problem == "camera *name* has no frames"
    assert found["footage.no_frames"].fix == "Add frames."


def test_every_setting_is_on_the_page(generator: Load) -> None:
    from pipelines.config import Config

    settings = generator("settings")
    page = settings.settings_page()
    names = settings.setting_names()
    assert {"capture", "capture.masks", "calibrate.board.square", "train.rates.means"} <= names
    assert set(Config.model_fields) <= names
    missing = [name for name in names if "." in name and f'<a id="{name}"></a>' not in page]
    assert not missing


@dataclass(frozen=True)
class Heading:
    """As `studio.settings` has it."""

    text: str


@dataclass(frozen=True)
class Affects:
    """As `studio.settings` has it."""

    results: tuple[str, ...]


def test_headings_and_what_a_change_makes_stale_are_on_the_page(generator: Load) -> None:
    class Inner(BaseModel):
        depth: int = Field(default=1, ge=0, description="How deep.")

    class Outer(BaseModel):
        affects: ClassVar[Affects] = Affects(("evaluation",))
        width: Annotated[int, Heading("Size"), Affects(("later_frames",))] = Field(default=3, description="How wide.")
        inner: Annotated[Inner, Affects(("keyframe", "videos"))] = Inner()
        height: int = Field(default=4, description="How high.")
        color: Annotated[int, Affects(())] = Field(default=5, description="Which color.")

    page = "\n".join(generator("settings").section("outer", Outer()))
    assert "### Size { #outer-size }" in page
    assert (
        '| <a id="outer.width"></a>`width` | `3` | How wide.<br>A change makes these results stale: later frames. |'
        in page
    )
    assert "How high.<br>A change makes these results stale: evaluation. |" in page
    assert "| Which color. |" in page, "a change of it affects nothing, whatever its model affects"
    assert "How deep.<br>*At least 0.*<br>A change makes these results stale: keyframe, videos." in page


def test_every_command_is_on_the_page(generator: Load) -> None:
    page = generator("commands").commands_page()
    for command in ("run", "calibrate", "status", "export", "import", "config"):
        assert f"## {command} {{ #{command} }}" in page
    assert "--keep NAME" in page
    assert "v3studio-gui" in page


def test_every_event_is_on_the_page(generator: Load) -> None:
    from pipelines.events import Finished, Progress

    page = generator("events").events_page()
    for event in (Progress, Finished):
        assert f"## {event.kind} {{ #{event.kind} }}" in page
    assert "| `label` | `str` | the step in progress" in page


def test_names_that_do_not_exist_are_found(generator: Load) -> None:
    text = "`studio/cameras.py`, `studio/gone.py`, `train.gone`, `capture.masks: none`, `numpy.array`\n"
    text += "```\n`studio/x`\n```"
    found = list(generator("names").unknown_names(text, ROOT, {"train", "capture", "capture.masks"}))
    assert found == ["studio/gone.py: no such file", "train.gone: no such setting"]


@pytest.mark.parametrize(
    ("text", "expected"),
    [("a|b {x} *y*", r"a\|b \{x\} \*y\*"), ("`code_span` and_more", r"`code_span` and\_more"), ("``two``", "`two`")],
)
def test_text_is_escaped_for_markdown(generator: Load, text: str, expected: str) -> None:
    assert generator("markdown").escaped(text) == expected
