"""All settings with their documentation, as a YAML file that can be edited and run."""

from __future__ import annotations

import textwrap
import types
from collections.abc import Iterator
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import yaml
from pydantic.fields import FieldInfo

from pipelines.config.section import Section
from pipelines.config.sections import Config

_WIDTH = 110


def describe(config: Config | None = None) -> str:
    """YAML of a configuration (the defaults without one), each setting under its documentation and bounds."""
    lines = ["# All settings of V3 Studio. What is left out of a file has the value shown by `v3studio config`.", ""]
    lines += _section(config or Config(), 0)
    return "\n".join(lines).rstrip() + "\n"


def allowed_values(field: FieldInfo) -> str:
    """Bounds and choices of a setting in words: "0 to 51", "one of cpu, cuda"; "" where anything goes."""
    parts = []
    choices = list(_choices(field.annotation))
    if choices:
        parts.append("one of " + ", ".join(map(str, choices)))
    bounds: dict[str, Any] = {}
    for rule in (*field.metadata, *_inner_rules(field.annotation)):
        for name in ("ge", "gt", "le", "lt"):
            if getattr(rule, name, None) is not None:
                bounds[name] = getattr(rule, name)
    low = f"at least {bounds['ge']}" if "ge" in bounds else f"above {bounds['gt']}" if "gt" in bounds else ""
    high = f"at most {bounds['le']}" if "le" in bounds else f"below {bounds['lt']}" if "lt" in bounds else ""
    if "ge" in bounds and "le" in bounds:
        parts.append(f"{bounds['ge']} to {bounds['le']}")
    else:
        parts += [text for text in (low, high) if text]
    if type(None) in get_args(field.annotation):
        parts.append("or null")
    return ", ".join(parts)


def _section(model: Section, depth: int) -> Iterator[str]:
    indent = "  " * depth
    for name, field in type(model).model_fields.items():
        value = getattr(model, name)
        if name in type(model).headings:
            yield f"{indent}# --- {type(model).headings[name]} ---"
            yield ""
        yield from _comment(field, indent)
        if isinstance(value, Section):
            yield f"{indent}{name}:"
            yield from _section(value, depth + 1)
        else:
            dumped = model.model_dump(mode="json", include={name})[name]
            text = (
                yaml.safe_dump(dumped, default_flow_style=True, allow_unicode=True, width=10**6)
                .removesuffix("...\n")
                .strip()
            )
            yield f"{indent}{name}: {text}"
        yield ""


def _comment(field: FieldInfo, indent: str) -> Iterator[str]:
    words = " ".join((field.description or "").split())
    allowed = allowed_values(field)
    if allowed:
        words += f" [{allowed}]"
    yield from textwrap.wrap(words, _WIDTH, initial_indent=f"{indent}# ", subsequent_indent=f"{indent}# ")


def _choices(annotation: Any) -> Iterator[Any]:
    if get_origin(annotation) is Literal:
        yield from get_args(annotation)
    elif get_origin(annotation) in (Union, types.UnionType, Annotated):
        for part in get_args(annotation):
            yield from _choices(part)


def _inner_rules(annotation: Any) -> Iterator[Any]:
    """Rules inside Annotated types; those of a tuple's or mapping's items count as well."""
    if get_origin(annotation) is Annotated:
        for rule in annotation.__metadata__:
            yield from getattr(rule, "metadata", [rule]) if isinstance(rule, FieldInfo) else [rule]
        annotation = annotation.__origin__
    for part in get_args(annotation):
        if get_origin(part) is Annotated or get_args(part):
            yield from _inner_rules(part)
