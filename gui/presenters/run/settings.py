"""Settings as edited in the window: one field per setting, derived from the settings models."""

from __future__ import annotations

import types
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal, Union, get_args, get_origin

import yaml

from pipelines.config import Config
from pipelines.config.description import allowed_values
from pipelines.config.loading import parse_override
from studio.settings import Heading, Settings, marker, submodel

SECTIONS = {
    "capture": ("capture",),
    "calibrate": ("calibrate",),
    "initialize": ("initialize",),
    "train": ("train",),
    "bake": ("bake",),
    "review": ("evaluate", "run"),
}
"""Sections of the settings shown for each stage."""

NULL = "null"
"""Text of a setting without a value, as in YAML."""


@dataclass(frozen=True)
class SettingField:
    """A setting.

    Attributes:
        name: dotted, as in train.max_splats.
        heading: heading of its block of settings.
        label: displayed name; for a nested setting it begins with the section.
        kind: "switch", "choice" or "text"; a switch that can be null is a choice.
        choices: values of a choice, `NULL` first if it can be null.
        text: whether the value is plain text (else it is parsed as YAML).
        nullable: whether it can be null; an empty field and "null" both mean null.
        documentation: description and bounds.
    """

    name: str
    heading: str
    label: str
    kind: str
    choices: tuple[str, ...]
    text: bool
    nullable: bool
    documentation: str

    def shown(self, config: Config) -> str:
        """The value as text: "true" or "false" for a switch, one of `choices` for a choice."""
        value: Any = config.model_dump(mode="json")
        for part in self.name.split("."):
            value = value[part]
        if isinstance(value, str):
            return value
        dumped: str = yaml.safe_dump(value, default_flow_style=True, allow_unicode=True, width=10**6)
        return dumped.removesuffix("...\n").strip()

    def parsed(self, text: str) -> Any:
        """Parse typed text.

        Raises:
            StudioError: not valid YAML.
        """
        text = text.strip()
        if self.nullable and text in ("", NULL, "~"):
            return None
        if self.text:
            return text
        return parse_override(f"{self.name}={text}")[1]


def fields_of(stage: str) -> list[SettingField]:
    """All settings of a stage, in order of declaration."""
    found: list[SettingField] = []
    for section in SECTIONS[stage]:
        model = submodel(Config.model_fields[section])
        assert model is not None
        found += _fields(model, f"{section}.")
    return found


def stage_of(setting: str) -> str:
    """The stage whose panel has a setting, by its dotted name; "" if no panel has it."""
    for stage in SECTIONS:
        if any(field.name == setting for field in fields_of(stage)):
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
        choices = tuple(map(str, get_args(kinds[0]))) if get_origin(kinds[0]) is Literal else ()
        nullable = len(kinds) < len(parts)
        if kinds == [bool] and nullable:
            choices = ("true", "false")
        kind = "choice" if choices else "switch" if kinds == [bool] else "text"
        # text settings keep words such as "off" and "1" as they are
        text = kinds != [bool] and all(
            part is str or getattr(part, "__name__", "") == "Path" or _all_text(part) for part in kinds
        )
        words = " ".join((field.description or "").split())
        allowed = allowed_values(field)
        yield SettingField(
            name=f"{prefix}{name}",
            heading=heading,
            label=within + name.replace("_", " "),
            kind=kind,
            choices=(NULL, *choices) if choices and nullable else choices,
            text=text,
            nullable=nullable,
            documentation=f"{words} [{allowed}]" if allowed else words,
        )


def _all_text(part: Any) -> bool:
    return get_origin(part) is Literal and all(isinstance(choice, str) for choice in get_args(part))
