"""The settings reference: every field of the settings models, with its documentation, bounds and default."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import yaml
from generate.markdown import code, escaped, table
from pydantic import BaseModel
from pydantic.fields import FieldInfo

INTRODUCTION = """# Settings

Every setting of a run. This page is generated from the settings models that validate a run, so it lists exactly what
the installed version accepts. `v3studio config` prints the same list as a YAML file that can be edited and run.

Set a value in a YAML file:

```yaml
train:
  max_splats: 36000
```

or on the command line, as `--train.max-splats 36000` or `--set train.max_splats=36000`. Settings that you leave out
have their defaults. Unknown names are refused.
"""


def settings_page() -> str:
    """Markdown of all settings."""
    from pipelines.config import Config

    lines = [INTRODUCTION]
    for name, field in Config.model_fields.items():
        lines += [f"## {name} {{ #{name} }}", "", escaped(field.annotation.__doc__ or ""), ""]
        lines += _section(name, getattr(Config(), name))
    return "\n".join(lines)


def setting_names() -> set[str]:
    """All dotted names: sections, settings, and settings of nested sections."""
    from pipelines.config import Config

    return set(_names("", Config()))


def old_names() -> str:
    """Markdown table of what settings, values and stages were called before."""
    from pipelines.config import renamed

    rows = [(code(f"{old}.*"), code(f"{new}.*")) for old, new in renamed.STAGES.items()]
    rows += [(code(old), code(new)) for old, new in renamed.SETTINGS.items()]
    for name, values in renamed.VALUES.items():
        rows += [(code(f"{name}: {old}"), code(f"{name}: {new}")) for old, new in values.items()]
    return "\n".join(table(("Old setting", "Setting"), *rows))


def _names(prefix: str, model: BaseModel) -> Iterator[str]:
    for name in type(model).model_fields:
        yield prefix + name
        value = getattr(model, name)
        if isinstance(value, BaseModel):
            yield from _names(f"{prefix}{name}.", value)


def _section(prefix: str, model: BaseModel) -> Iterator[str]:
    headings = getattr(type(model), "headings", {})
    rows: list[tuple[str, ...]] = []
    nested: list[tuple[str, FieldInfo, BaseModel]] = []
    for name, field in type(model).model_fields.items():
        if name in headings:
            yield from _table(rows)
            rows = []
            yield from (f"### {headings[name]} {{ #{prefix}-{_slug(headings[name])} }}", "")
        value = getattr(model, name)
        dotted = f"{prefix}.{name}"
        if isinstance(value, BaseModel):
            nested.append((dotted, field, value))
            description = f"{_words(field)} [Its settings](#{dotted.replace('.', '-')})."
            rows.append((_anchor(dotted, name), "", description))
        else:
            rows.append((_anchor(dotted, name), code(_default(model, name)), _words(field)))
    yield from _table(rows)
    for dotted, _, value in nested:
        yield from (f"### {dotted} {{ #{dotted.replace('.', '-')} }}", "", escaped(type(value).__doc__ or ""), "")
        yield from _section(dotted, value)


def _table(rows: list[tuple[str, ...]]) -> Iterator[str]:
    if rows:
        yield from [*table(("Setting", "Default", "Description"), *rows), ""]


def _anchor(dotted: str, name: str) -> str:
    return f'<a id="{dotted}"></a>`{name}`'


def _words(field: FieldInfo) -> str:
    from pipelines.config.description import allowed_values

    text = escaped(field.description or "")
    allowed = allowed_values(field)
    return f"{text}<br>*{escaped(allowed[0].upper() + allowed[1:])}.*" if allowed else text


def _default(model: BaseModel, name: str) -> str:
    value: Any = model.model_dump(mode="json", include={name})[name]
    return yaml.safe_dump(value, default_flow_style=True, width=10**6).removesuffix("...\n").strip()


def _slug(text: str) -> str:
    return "-".join("".join(letter if letter.isalnum() else " " for letter in text.lower()).split())
