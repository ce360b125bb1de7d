"""The settings reference: every field of the settings models, with its documentation, bounds and default."""

from collections.abc import Iterator

from generate.markdown import code, escaped, table
from pydantic.fields import FieldInfo

from v3studio.pipelines.config.config import Config, values_of
from v3studio.pipelines.config.description import allowed_values
from v3studio.studio.settings import Heading, Settings, affected, marker
from v3studio.studio.yaml_text import inline_yaml

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
    lines = [INTRODUCTION]
    for name, field in Config.model_fields.items():
        lines += [f"## {name} {{ #{name} }}", "", escaped((field.annotation.__doc__ or "").partition("\n\n")[0]), ""]
        lines += section(f"{name}.", getattr(Config(), name))
    return "\n".join(lines)


def setting_names() -> set[str]:
    """All dotted names: sections, settings, and settings of nested sections."""
    return {".".join(name.split(".")[:n]) for name in affected(Config) for n in range(1, name.count(".") + 2)}


def section(prefix: str, model: Settings) -> Iterator[str]:
    rows: list[tuple[str, ...]] = []
    nested: list[tuple[str, Settings]] = []
    for name, field in type(model).model_fields.items():
        heading, value, dotted = marker(field, Heading), getattr(model, name), f"{prefix}{name}"
        slug = dotted.replace(".", "-")
        if heading is not None:
            yield from _table(rows)
            rows = []
            yield from (f"### {heading.text} {{ #{prefix[:-1]}-{_slug(heading.text)} }}", "")
        anchor = f'<a id="{dotted}"></a>`{name}`'
        if isinstance(value, Settings):
            nested.append((dotted, value))
            rows.append((anchor, "", f"{_words(field)} [Its settings](#{slug})."))
        else:
            names = ", ".join(escaped(result.replace("_", " ")) for result in affected(Config)[dotted])
            stale = f"<br>Affects: {names}." if names else ""
            rows.append((anchor, code(inline_yaml(values_of(Config())[dotted])), _words(field) + stale))
    yield from _table(rows)
    for dotted, value in nested:
        yield from (f"### {dotted} {{ #{dotted.replace('.', '-')} }}", "", escaped(type(value).__doc__ or ""), "")
        yield from section(f"{dotted}.", value)


def _table(rows: list[tuple[str, ...]]) -> Iterator[str]:
    if rows:
        yield from [*table(("Setting", "Default", "Description"), *rows), ""]


def _words(field: FieldInfo) -> str:
    text = escaped(field.description or "")
    allowed = allowed_values(field)
    return f"{text}<br>*{escaped(allowed[0].upper() + allowed[1:])}.*" if allowed else text


def _slug(text: str) -> str:
    return "-".join("".join(letter if letter.isalnum() else " " for letter in text.lower()).split())
