"""The reference of the events that `--json` prints, from their classes."""

import inspect
import re
from collections.abc import Iterator
from dataclasses import fields

from generate.markdown import code, escaped, table

INTRODUCTION = """# Events

With `--json`, a command prints events: each is a JSON object on a line of standard output. The last is
[finished](#finished). A take keeps the events of its last run in `.v3studio/events.jsonl`. Readers should ignore
unknown fields.

If a command writes something, `result.path` of its last event is the absolute path of that file or folder:

```sh
v3studio export my-take --format ply --out plys --json | tail -n 1 | jq -r .result.path
```

Every event has `event` (its kind, the title below), `time` (seconds since 1970) and `stage` (empty for the entire run).
NaN and infinity are null.
"""

_JSON = {
    "str": "string",
    "float": "number",
    "int": "integer",
    "bool": "boolean",
    "None": "null",
    "tuple": "array",
    "Mapping": "object",
    "JsonData": "any",
}


def events_page() -> str:
    """Markdown of all events."""
    from v3studio.pipelines import events

    common = {field.name for field in fields(events.Event)}
    lines = [INTRODUCTION]
    for cls in events.KINDS.values():
        said = {name: text for base in reversed(cls.__mro__[:-1]) for name, text in _comments(base)}
        lines += [f"## {cls.kind} {{ #{cls.kind} }}", "", escaped(inspect.cleandoc(cls.__doc__ or "")), ""]
        rows = [
            (code(field.name), " or ".join(_json(str(field.type))), escaped(said.get(field.name, "")))
            for field in fields(cls)
            if field.name not in common
        ]
        lines += [*table(("Field", "Type", "Meaning"), *rows), ""]
    return "\n".join(lines)


def _comments(cls: type) -> Iterator[tuple[str, str]]:
    """The fields of a class with the comments beside or above them."""
    source = inspect.getsource(cls)
    for above, name, beside in re.findall(r"((?:^    # .*\n)*)^    (\w+): [^#\n]*(?:# (.*))?$", source, re.MULTILINE):
        text = beside or " ".join(re.findall("# (.*)", above))
        yield name, re.sub(r"\bNone\b", "null", text)


def _json(kind: str) -> list[str]:
    """JSON's names of the types in an annotation, without those of items."""
    return [_JSON[re.match(r"\w+", part)[0]] for part in kind.split(" | ")]
