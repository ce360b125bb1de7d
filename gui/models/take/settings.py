"""Settings as edited in the window: one field per setting, derived from the settings models."""

import math
import types
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import cache, lru_cache
from pathlib import Path
from typing import Any, Literal, Union, cast, get_args, get_origin

from pydantic import JsonValue
from pydantic.fields import FieldInfo

from v3studio.gui.drawing.plots import round_step
from v3studio.gui.models.stage_rows import TITLES
from v3studio.gui.models.take.setting_words import BASIC, FOLDERS, LABELS, UNITS
from v3studio.pipelines.config import Config
from v3studio.pipelines.config.description import allowed_values, bounds
from v3studio.pipelines.config.loading import parse_override
from v3studio.pipelines.new_take import typed_span
from v3studio.pipelines.takes.files.path_here import path_here
from v3studio.studio.capture.settings import CameraName
from v3studio.studio.settings import Empty, Heading, Settings, marker, submodel
from v3studio.studio.storage import is_address
from v3studio.studio.yaml_text import inline_yaml

SECTIONS = {stage: (stage,) * (stage in Config.model_fields) for stage in TITLES} | {"review": ("evaluate", "run")}
"""Sections of the settings shown for each stage."""

NULLS = ("", "null", "~")  # texts that mean no value, besides the setting's own word
SWITCH_WORDS = {"true": "on", "false": "off"}  # of a switch that can also be without a value
WIDEST_STEPS = 100  # whole numbers between more distant limits have no buttons that step them


class FieldKind(StrEnum):
    """The way in which a setting is edited. A switch that can be null is a choice."""

    SWITCH = "switch"
    CHOICE = "choice"
    TEXT = "text"


class ListKind(StrEnum):
    """The kind of list that a setting is; it is shown without brackets."""

    NONE = ""  # it is no list
    LIST = "list"
    NAMES = "names"
    MAPPING = "mapping"


@dataclass(frozen=True)
class SettingField:
    """A setting."""

    name: str  # dotted, as in train.max_splats
    heading: str
    label: str  # displayed name; for a nested setting it begins with the section
    kind: FieldKind
    choices: tuple[str, ...]  # values of a choice, `empty` first if it can be null
    text: bool  # whether the value is plain text (else it is parsed as YAML)
    nullable: bool  # whether it can be null; `empty`, an empty field and "null" all mean null
    documentation: str
    empty: str = ""  # word for null, an empty list or an empty mapping; "" if it is never empty
    kind_of_list: ListKind = ListKind.NONE
    # lowest and highest value of a number that can be stepped; None for others
    limits: tuple[float, float] | None = None
    whole: bool = False

    @property
    def basic(self) -> bool:
        """Whether most people need it."""
        return self.name in BASIC

    def shown(self, config: Config) -> str:
        """The value as text: "true" or "false" for a switch, one of `choices` for a choice."""
        value: Any = setting_value(config, self.name)
        if self.empty and value in (None, [], {}):
            return self.empty
        if isinstance(value, str):
            return _words(value) if _words(value) in self.choices else value
        if self.kind_of_list == ListKind.NAMES and not any(set(name) & set(",[]") for name in value):
            return ", ".join(value)
        text = inline_yaml(value)
        if self.kind == FieldKind.CHOICE:
            return SWITCH_WORDS.get(text, text) if self.nullable else text
        items = value.values() if isinstance(value, dict) else value
        flat = self.kind_of_list and not any(isinstance(item, (list, dict)) for item in items)
        return text[1:-1].strip() if flat else text

    def parsed(self, text: str) -> Any:
        """Parse typed text. Raises StudioError: not valid YAML."""
        text = text.strip()
        nothing = text in NULLS or (self.empty != "" and text.casefold() == self.empty.casefold())
        if self.nullable and nothing:
            return None
        if self.kind == FieldKind.CHOICE and text in self.choices:
            text = text.replace(" ", "_")
        if self.name == "capture.frames" and (span := typed_span(text)) is not None:
            return f"{span[0]}:{span[1] + 1}"
        if self.text:
            return text
        if self.kind_of_list == ListKind.NAMES and not text.startswith("["):
            return [name.strip() for name in text.split(",") if name.strip() and not nothing]
        if self.kind == FieldKind.CHOICE:
            text = next((value for value, word in SWITCH_WORDS.items() if word == text), text)
        if self.kind_of_list == ListKind.LIST:
            text = "[]" if nothing else text if text.startswith("[") else f"[{text}]"
        elif self.kind_of_list == ListKind.MAPPING:
            text = "{}" if nothing else text if text.startswith("{") else f"{{{text}}}"
        return parse_override(f"{self.name}={text}")[1]

    def stepped(self, text: str, count: int) -> str | None:
        """A number moved to a multiple of its step, and kept within its limits, as text, `text` itself if it stays the
        same; None if there are no limits, or it is no number. The step is 1 for whole numbers, else a twentieth of the
        range, rounded up to 1, 2 or 5 times a power of ten: 0.05 from 0 to 1. From between two multiples, the first
        step leads to the next one."""
        try:
            value = float(text)
        except ValueError:
            return None
        if self.limits is None or not math.isfinite(value):
            return None
        low, high = self.limits
        step = 1.0 if self.whole else round_step((high - low) / 20)
        near = 1e-9  # a multiple that is not exact in binary is one
        multiple = math.floor(value / step + near) if count > 0 else math.ceil(value / step - near)
        moved = min(max((multiple + count) * step, low), high)
        if math.isclose(moved, value, abs_tol=near):
            return text
        return str(round(moved)) if self.whole else f"{moved:.6g}"


def setting_value(config: Config, name: str) -> JsonValue:
    """The JSON-ready value of a setting, by its dotted name."""
    value: Any = config.model_dump(mode="json")
    for part in name.split("."):
        value = value[part]
    return cast(JsonValue, value)


@cache
def fields_of(stage: str) -> tuple[SettingField, ...]:
    """All settings of a stage, in order of declaration."""
    fields: list[SettingField] = []
    for section in SECTIONS[stage]:
        model = submodel(Config.model_fields[section])
        assert model is not None
        fields += _fields(model, f"{section}.")
    return tuple(fields)


@lru_cache(maxsize=256)
def stage_of(setting: str) -> str:
    """The stage whose panel has a setting, or a block of them ("calibrate.board"), by its dotted name; else ""."""
    for stage in SECTIONS:
        if any(field.name == setting or field.name.startswith(f"{setting}.") for field in fields_of(stage) if setting):
            return stage
    return ""


def matching(fields: Sequence[SettingField], words: str) -> list[SettingField]:
    """Fields whose name, label, heading or documentation contains all words; a full name matches only that field."""
    exact = [field for field in fields if field.name == words.strip()]
    if exact:
        return exact
    searched = words.lower().split()

    def text(field: SettingField) -> str:
        return f"{field.name} {field.label} {field.heading} {field.documentation}".lower()

    return [field for field in fields if all(word in text(field) for word in searched)]


def _fields(model: type[Settings], prefix: str, heading: str = "", within: str = "") -> Iterator[SettingField]:
    for name, field in model.model_fields.items():
        annotation = field.annotation
        own = marker(field, Heading)
        heading = own.text if own is not None else heading
        inner = submodel(field)
        if inner is not None:
            title = (field.description or name).split(".")[0]
            yield from _fields(inner, f"{prefix}{name}.", title, f"{name}: ")
            continue
        parts = get_args(annotation) if get_origin(annotation) in (Union, types.UnionType) else (annotation,)
        kinds = [part for part in parts if part is not type(None)]
        choices = tuple(map(_words, get_args(kinds[0]))) if get_origin(kinds[0]) is Literal else ()
        nullable = len(kinds) < len(parts)
        if kinds == [bool] and nullable:
            choices = tuple(SWITCH_WORDS.values())
        kind = FieldKind.CHOICE if choices else FieldKind.SWITCH if kinds == [bool] else FieldKind.TEXT
        # text settings keep words such as "off" and "1" as they are
        text = kinds != [bool] and all(
            part is str or getattr(part, "__name__", "") == "Path" or _all_text(part) for part in kinds
        )
        words = " ".join((field.description or "").split())
        allowed = allowed_values(field)
        empty, unit = (marker(field, Empty) or Empty("")).text, UNITS.get(f"{prefix}{name}", "")
        whole = kinds == [int]
        yield SettingField(
            name=f"{prefix}{name}",
            heading=heading,
            label=LABELS.get(f"{prefix}{name}", within + name.replace("_", " ")) + (f" ({unit})" if unit else ""),
            kind=kind,
            choices=(empty, *choices) if choices and nullable else choices,
            text=text,
            nullable=nullable,
            documentation=f"{words} [{allowed}]" if allowed else words,
            empty=empty,
            kind_of_list=_kind_of_list(kinds[0]) if len(kinds) == 1 else ListKind.NONE,
            limits=_limits(field, whole) if len(kinds) == 1 and kinds[0] in (int, float) and not nullable else None,
            whole=whole,
        )


def _kind_of_list(kind: Any) -> ListKind:
    if get_origin(kind) is dict:
        return ListKind.MAPPING
    if get_origin(kind) not in (tuple, list):
        return ListKind.NONE
    return ListKind.NAMES if get_args(kind)[0] in (str, CameraName) else ListKind.LIST


def _words(choice: str) -> str:
    return choice.replace("_", " ") if choice.islower() else choice


def _limits(field: FieldInfo, whole: bool) -> tuple[float, float] | None:
    """Both bounds, if a few steps lead from one to the other."""
    low, high = bounds(field)
    if low is None or high is None or high - low > (WIDEST_STEPS if whole else 1):
        return None
    return low, high


def _all_text(part: Any) -> bool:
    return get_origin(part) is Literal and all(isinstance(choice, str) for choice in get_args(part))


def place_of(field: SettingField, config: Config) -> Path:
    """The path at which a dialog begins that chooses the file or folder of a setting: there, if it exists, else in the
    capture's folder as it is mounted here, else at home."""
    root = Path.home() if is_address(config.capture.root) else path_here(config.capture.root, config.run.paths)
    root = root if root.is_dir() else Path.home()
    now = root if field.name in FOLDERS else root / field.shown(config)
    return now if now.exists() else root
