"""The settings reference: every field of the settings models, with its documentation, bounds and default."""

from collections.abc import Iterator
from typing import Any

from generate.markdown import code, escaped, table
from pydantic import BaseModel
from pydantic.fields import FieldInfo

INTRODUCTION = """# Settings

`v3studio config` prints this list as a YAML file that you can edit and run. Set a value in a YAML file:

```yaml
train:
  max_splats: 36000
```

or on the command line, as `--train.max-splats 36000` or `--set train.max_splats=36000`. Omitted settings have their
defaults. Unknown names are refused. *Affects* names the results that are made again if the setting changes.
"""


def settings_page() -> str:
    """Markdown of all settings."""
    from pipelines.config import Config

    lines = [INTRODUCTION]
    for name, field in Config.model_fields.items():
        lines += [f"## {name} {{ #{name} }}", "", escaped((field.annotation.__doc__ or "").partition("\n\n")[0]), ""]
        lines += section(name, getattr(Config(), name))
    return "\n".join(lines)


def setting_names() -> set[str]:
    """All dotted names: sections, settings, and settings of nested sections."""
    from pipelines.config import Config

    return set(_names("", Config()))


def _names(prefix: str, model: BaseModel) -> Iterator[str]:
    for name in type(model).model_fields:
        yield prefix + name
        value = getattr(model, name)
        if isinstance(value, BaseModel):
            yield from _names(f"{prefix}{name}.", value)


def section(prefix: str, model: BaseModel, affects: tuple[str, ...] = ()) -> Iterator[str]:
    affects = _results(getattr(type(model), "affects", None), affects)
    rows: list[tuple[str, ...]] = []
    nested: list[tuple[str, BaseModel, tuple[str, ...]]] = []
    for name, field in type(model).model_fields.items():
        heading = getattr(type(model), "headings", {}).get(name) or _marker(field, "Heading", "text")
        if heading:
            yield from _table(rows)
            rows = []
            yield from (f"### {heading} {{ #{prefix}-{_slug(heading)} }}", "")
        changed = _results(_marker(field, "Affects"), affects)
        value = getattr(model, name)
        dotted = f"{prefix}.{name}"
        if isinstance(value, BaseModel):
            nested.append((dotted, value, changed))
            description = f"{_words(field)} [Its settings](#{dotted.replace('.', '-')})."
            rows.append((_anchor(dotted, name), "", description))
        else:
            rows.append((_anchor(dotted, name), code(_default(model, name)), _words(field) + _stale(changed)))
    yield from _table(rows)
    for dotted, value, changed in nested:
        yield from (f"### {dotted} {{ #{dotted.replace('.', '-')} }}", "", escaped(type(value).__doc__ or ""), "")
        yield from section(dotted, value, changed)


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


def _marker(field: FieldInfo, kind: str, attribute: str | None = None) -> Any:
    """The field's marker of that class in `Annotated` (see `studio.settings`), or one of its attributes; else None."""
    found = next((item for item in field.metadata if type(item).__name__ == kind), None)
    return getattr(found, attribute) if found is not None and attribute else found


def _results(affects: Any, outer: tuple[str, ...]) -> tuple[str, ...]:
    """What the marker says, which may be nothing; `outer` without a marker."""
    return tuple(affects.results) if affects is not None else outer


def _stale(results: tuple[str, ...]) -> str:
    names = ", ".join(escaped(name.replace("_", " ")) for name in results)
    return f"<br>Affects: {names}." if names else ""


def _default(model: BaseModel, name: str) -> str:
    value: Any = model.model_dump(mode="json", include={name})[name]
    from studio.yaml_text import inline_yaml

    return inline_yaml(value)


def _slug(text: str) -> str:
    return "-".join("".join(letter if letter.isalnum() else " " for letter in text.lower()).split())
