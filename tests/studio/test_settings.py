"""The settings models: each setting is declared once, with documentation, bounds and the results that it affects."""

import ast
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import pytest
from pydantic.fields import FieldInfo

from v3studio.pipelines.config import Config
from v3studio.pipelines.config.description import allowed_values
from v3studio.studio.calibration.target.pattern import MARKERS
from v3studio.studio.errors import StudioError
from v3studio.studio.settings import Settings, Unbounded, affected, marker, submodel
from v3studio.studio.stream import BakeSettings
from v3studio.studio.training.settings import LearningRates


def models(model: type[Settings] = Config) -> Iterator[type[Settings]]:
    """The model, its bases and those of its fields."""
    yield model
    for base in model.__mro__[1:]:
        if issubclass(base, Settings) and base is not Settings:
            yield base
    for field in model.model_fields.values():
        inner = submodel(field)
        if inner is not None:
            yield from models(inner)


def fields(model: type[Settings] = Config, prefix: str = "") -> Iterator[tuple[str, FieldInfo]]:
    """Every setting, by dotted name."""
    for name, field in model.model_fields.items():
        inner = submodel(field)
        if inner is not None:
            yield from fields(inner, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", field


FIELDS = dict(fields())


def test_no_setting_is_declared_in_two_models() -> None:
    homes: dict[str, set[type[Settings]]] = {}
    for model in models():
        for name in model.__annotations__:
            if name in model.model_fields:
                homes.setdefault(name, set()).add(model)
    assert len(homes) > 100
    twice = {name for name, places in homes.items() if len(places) > 1}
    # evaluate.background is for evaluation, train.background for training; train.rates.scale is a learning rate
    assert twice == {"background", "scale"}


def dataclass_defaults(path: Path) -> Iterator[tuple[str, str]]:
    """(class, field) of the fields with a default of the dataclasses in a file."""
    text = path.read_text(encoding="utf-8")
    for node in ast.walk(ast.parse(text)) if "@dataclass" in text else ():
        if isinstance(node, ast.ClassDef) and "dataclass" in "".join(map(ast.unparse, node.decorator_list)):
            for item in node.body:
                if isinstance(item, ast.AnnAssign) and item.value is not None:
                    yield node.name, ast.unparse(item.target)


RESULTS_OF_THE_SAME_NAME = {"Evaluation.held_out", "StreamMetadata.view_range", "VideoWriter.sh_degree"}
"""Fields named like a setting: results (what was held out, and the range that was seen), and an option of `export`."""


def test_no_dataclass_repeats_a_setting() -> None:
    """Settings that are declared twice drift apart. Names without an underscore are too common to be checked."""
    root = Path(__file__).parents[2]
    names = {last for name in FIELDS if "_" in (last := name.rsplit(".", 1)[-1])}
    assert len(names) > 70
    repeated = [
        f"{path.relative_to(root)}: {owner}.{name}"
        for package in ("studio", "pipelines", "gui")
        for path in sorted((root / package).rglob("*.py"))
        for owner, name in dataclass_defaults(path)
        if name in names and f"{owner}.{name}" not in RESULTS_OF_THE_SAME_NAME
    ]
    assert not repeated, "\n".join(repeated)


@pytest.mark.parametrize("name", sorted(FIELDS))
def test_every_setting_says_what_it_is_and_what_it_affects(name: str) -> None:
    field = FIELDS[name]
    assert field.description
    assert field.description.rstrip()[-1] in ".)", "a sentence"
    unbounded = marker(field, Unbounded)
    if any(kind in repr(field.annotation) for kind in ("int", "float")):
        assert bool(allowed_values(field).removesuffix("or null").strip(", ")) != (unbounded is not None)
    assert name in affected(Config)


def test_what_settings_affect_is_what_stages_ask_for() -> None:
    """A result that no stage asks for would never be stale; one that no setting affects is misspelled."""
    stages = Path(__file__).parents[2] / "pipelines" / "stages"
    calls = (
        node
        for path in stages.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Call) and ast.unparse(node.func) == "settings_affecting"
    )
    asked = {node.value for call in calls for node in ast.walk(call) if isinstance(node, ast.Constant)}
    asked.add("grouping")  # stages compare where groups begin instead
    assert {result for results in affected(Config).values() for result in results} == asked


def test_what_settings_affect_is_said_at_the_field_the_section_or_the_class() -> None:
    affects = affected(Config)
    assert affects["train.max_splats"] == ("keyframe",)
    assert affects["train.motion_views"] == ("later_frames",)
    assert affects["train.rates.opacity"] == ("keyframe",)  # from the class that contains it
    assert affects["run.check_footage"] == affects["run.threads"] == ()
    # from the field that contains its model
    assert affects["calibrate.board.square"] == affects["calibrate.board.kind"]


@pytest.mark.parametrize(
    ("model", "values", "code", "setting"),
    [
        (LearningRates, {"means": -1}, "settings.invalid", "means"),
        (BakeSettings, {"qualty": 30}, "settings.unknown", "qualty"),
        (BakeSettings, {"ladder": [{"qp": 99}]}, "settings.invalid", "ladder"),
        (Config, {"train": {"rates": {"means": -1}}}, "settings.invalid", "train.rates.means"),
    ],
)
def test_bad_values_raise_our_error(model: type[Settings], values: dict[str, Any], code: str, setting: str) -> None:
    with pytest.raises(StudioError) as caught:
        model(**values)
    assert (caught.value.code, caught.value.fields["setting"]) == (code, setting)
    assert model.__name__ in str(caught.value)
    assert caught.value.fix


def test_dictionaries_are_opencvs() -> None:
    theirs = {
        name: len(cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name)).bytesList)
        for name in dir(cv2.aruco)
        if name.startswith("DICT_") and name.isupper()
    }
    assert theirs == MARKERS
