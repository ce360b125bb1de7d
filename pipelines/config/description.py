"""All settings with their documentation, as a YAML file that can be edited and used."""

import textwrap
import types
from collections.abc import Collection, Iterator
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic.fields import FieldInfo

from v3studio.pipelines.config.config import Config
from v3studio.studio.settings import Heading, Settings, marker
from v3studio.studio.yaml_text import inline_yaml

_WIDTH = 110


def describe(config: Config, names: Collection[str] | None = None) -> str:
    """YAML of a configuration, or of some settings by `names`, each below its documentation and bounds."""
    title = [] if names is not None else ["# All settings. Those missing from a file have their defaults.", ""]
    return "\n".join([*title, *_section(config, "", names)]).rstrip() + "\n"


def allowed_values(field: FieldInfo) -> str:
    """Bounds and choices of a setting as text: "0 to 51", "one of cpu, cuda"; "" if there are none."""
    parts = []
    choices = list(_choices(field.annotation))
    if choices:
        parts.append("one of " + ", ".join(map(str, choices)))
    rules = _rules(field)
    low = f"at least {rules['ge']}" if "ge" in rules else f"above {rules['gt']}" if "gt" in rules else ""
    high = f"at most {rules['le']}" if "le" in rules else f"below {rules['lt']}" if "lt" in rules else ""
    if "ge" in rules and "le" in rules:
        parts.append(f"{rules['ge']} to {rules['le']}")
    else:
        parts += [text for text in (low, high) if text]
    if type(None) in get_args(field.annotation):
        parts.append("or null")
    return ", ".join(parts)


def bounds(field: FieldInfo) -> tuple[float | None, float | None]:
    """The lowest and the highest value of a setting, where there are such limits; exclusive ones count too."""
    rules = _rules(field)
    return rules.get("ge", rules.get("gt")), rules.get("le", rules.get("lt"))


def _rules(field: FieldInfo) -> dict[str, float]:
    rules = (*field.metadata, *_inner_rules(field.annotation))
    limits = ((name, getattr(rule, name, None)) for rule in rules for name in ("ge", "gt", "le", "lt"))
    return {name: value for name, value in limits if value is not None}


def _section(model: Settings, prefix: str, names: Collection[str] | None) -> Iterator[str]:
    indent = "  " * prefix.count(".")
    for name, field in type(model).model_fields.items():
        value, full = getattr(model, name), f"{prefix}{name}"
        if names is not None and not any(chosen == full or chosen.startswith(f"{full}.") for chosen in names):
            continue
        heading = marker(field, Heading)
        if heading is not None and names is None:
            yield f"{indent}# --- {heading.text} ---"
            yield ""
        allowed = allowed_values(field)
        words = " ".join((field.description or "").split()) + (f" [{allowed}]" if allowed else "")
        yield from textwrap.wrap(words, _WIDTH, initial_indent=f"{indent}# ", subsequent_indent=f"{indent}# ")
        if isinstance(value, Settings):
            yield f"{indent}{name}:"
            yield from _section(value, f"{full}.", names)
        else:
            dumped = model.model_dump(mode="json", include={name})[name]
            yield f"{indent}{name}: {inline_yaml(dumped)}"
        yield ""


def _choices(annotation: Any) -> Iterator[Any]:
    if get_origin(annotation) is Literal:
        yield from get_args(annotation)
    elif get_origin(annotation) in (Union, types.UnionType, Annotated):
        for part in get_args(annotation):
            yield from _choices(part)


def _inner_rules(annotation: Any) -> Iterator[Any]:
    """Bounds inside Annotated types, including those of the items of tuples and mappings."""
    if get_origin(annotation) is Annotated:
        for rule in annotation.__metadata__:
            yield from getattr(rule, "metadata", [rule]) if isinstance(rule, FieldInfo) else [rule]
        annotation = annotation.__origin__
    for part in get_args(annotation):
        if get_origin(part) is Annotated or get_args(part):
            yield from _inner_rules(part)
