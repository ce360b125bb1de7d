"""The reference of the events that `--json` prints, from their classes."""

from __future__ import annotations

import inspect
import re
import typing
from dataclasses import fields

from generate.markdown import code, escaped, table

INTRODUCTION = """# Events

A run reports its progress as events. With `--json`, each event is printed immediately as one JSON object on a line of
standard output. The events of the last run are also stored in the take, as `.v3studio/events.jsonl`. The command line
shows them as progress bars; the window reads the same lines.

Readers should ignore unknown fields. Every event has `event`, `stage` (the stage that it is about; empty for the entire
run) and `time` (seconds since 1970). NaN and infinity are written as null.

This page is generated from the event classes in `pipelines.events`.
"""


def events_page() -> str:
    """Markdown of all events."""
    from pipelines import events

    common = {field.name for field in fields(events.Event)}
    kinds = typing.get_args(events.AnyEvent)  # in the order in which they are declared
    lines = [INTRODUCTION]
    for cls in kinds:
        summary, _, attributes = inspect.cleandoc(cls.__doc__ or "").partition("Attributes:")
        said = {
            name: " ".join(text.split())
            for name, text in re.findall(r"^ *(\w+): (.*(?:\n {6,}.*)*)", attributes, flags=re.MULTILINE)
        }
        lines += [f"## {cls.kind} {{ #{cls.kind} }}", "", escaped(summary), ""]
        rows = [
            (code(field.name), code(str(field.type)), escaped(said.get(field.name, "")))
            for field in fields(cls)
            if field.name not in common
        ]
        if any(row[2] for row in rows):
            lines += [*table(("Field", "Type", "Meaning"), *rows), ""]
        elif rows:
            lines += [*table(("Field", "Type"), *(row[:2] for row in rows)), ""]
    return "\n".join(lines)
