"""Changes a value in a YAML file of settings and keeps its comments and the order of its keys."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import BaseModel

from pipelines.config.loading import dump_config, load_config, read_yaml
from pipelines.takes.atomic_files import write_text
from studio.bounded_files import read_bounded_text
from studio.errors import StudioError, reason_of
from studio.yaml_text import YamlError, dump_with_comments, parse_with_comments

if TYPE_CHECKING:
    from pipelines.config import Config

MAX_BYTES = 1_000_000
"""Larger files are refused: settings take a few kilobytes."""

MAX_DEPTH = 30
"""Deepest nesting of mappings and lists."""

MAX_NODES = 100_000
"""Values in a file, with every alias expanded: stops "billion laughs" files."""

_FIX = "Fix the file, or write a new one with `v3studio config > FILE`."


def set_settings(path: Path, values: Mapping[str, Any]) -> None:
    """Set JSON-ready values by dotted name ("calibrate.board.columns") in a YAML file, atomically; comments, order and
    all other values are kept.

    Missing sections and settings are appended. A value that does not change is not rewritten, so a file that already
    has all values keeps its bytes. StudioError if the file is not a YAML mapping or exceeds a limit
    (`settings.not_yaml`), or cannot be read (`settings.unreadable`); OSError if it cannot be written.
    """
    text = changed_text(path, values)
    if text is not None:
        write_text(path, text)


def changed_text(path: Path, values: Mapping[str, Any]) -> str | None:
    """What `set_settings` writes; None if all values are there already. See there."""
    before = _read(path) if path.exists() else ""
    tree = _parse(before, path)
    changed = not path.exists()
    for name, value in values.items():
        *sections, last = name.split(".")
        target = tree
        for section in sections:
            found = target.get(section)
            if not isinstance(found, dict):
                found = target[section] = type(tree)()
            target = found
        if last not in target or _plain(target[last]) != value:
            target[last] = value
            changed = True
    return dump_with_comments(tree) if changed else None


def save_config(path: Path, config: Config) -> None:
    """Write all settings to a YAML file, keeping its comments and order; a damaged one is replaced."""
    if path.exists():
        with contextlib.suppress(StudioError):
            before = read_yaml(path)
            if before == config.model_dump(mode="json"):
                return
            set_settings(path, dict(_leaves(config)))
            if load_config(path) == config:
                return
    write_text(path, dump_config(config))


def _leaves(config: BaseModel, prefix: str = "") -> Iterator[tuple[str, Any]]:
    values = config.model_dump(mode="json")
    for name in type(config).model_fields:
        value = getattr(config, name)
        if isinstance(value, BaseModel):
            yield from _leaves(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", values[name]


def _read(path: Path) -> str:
    try:
        if path.stat().st_size > MAX_BYTES:
            raise _refused(path, f"larger than {MAX_BYTES:,} bytes")
        return read_bounded_text(path)
    except (OSError, UnicodeDecodeError) as error:
        raise StudioError("settings.unreadable", f"cannot be read ({reason_of(error)})", file=path, fix=_FIX) from None


def _parse(text: str, path: Path) -> Any:
    from ruamel.yaml.comments import CommentedMap

    _check_depth(text, path)
    try:
        tree = parse_with_comments(text)
    except YamlError as error:
        raise _refused(path, str(error), line=error.line) from None
    if tree is None:
        return CommentedMap()
    if not isinstance(tree, CommentedMap):
        raise _refused(path, "expected sections such as 'capture:' and 'train:'")
    _count(tree, path)
    return tree


def _check_depth(text: str, path: Path) -> None:
    """Check for deep nesting and recursive anchors in the parser's events: building the tree would exhaust the stack
    on the former and silently drops the latter."""
    from ruamel.yaml import YAML
    from ruamel.yaml.error import YAMLError
    from ruamel.yaml.events import AliasEvent, MappingEndEvent, MappingStartEvent, SequenceEndEvent, SequenceStartEvent

    anchors: list[str | None] = []  # of the mappings and lists that are open
    try:
        for event in YAML(typ="safe", pure=True).parse(text):
            if isinstance(event, (MappingStartEvent, SequenceStartEvent)):
                anchors.append(event.anchor)
                if len(anchors) > MAX_DEPTH:
                    raise _refused(path, f"nested deeper than {MAX_DEPTH} levels")
            elif isinstance(event, (MappingEndEvent, SequenceEndEvent)):
                anchors.pop()
            elif isinstance(event, AliasEvent) and event.anchor in anchors:
                raise _refused(path, f"the anchor '{event.anchor}' contains itself")
    except YAMLError:
        return  # reported with its line when the tree is built


def _count(tree: Any, path: Path) -> None:
    """Count values with aliases expanded."""
    sizes: dict[int, int] = {}

    def size(value: Any) -> int:
        if not isinstance(value, (dict, list)):
            return 1
        if id(value) not in sizes:
            items = value.values() if isinstance(value, dict) else value
            sizes[id(value)] = 1 + sum(size(item) for item in items)
        return sizes[id(value)]

    if size(tree) > MAX_NODES:
        raise _refused(path, f"more than {MAX_NODES:,} values with aliases expanded")


def _refused(path: Path, problem: str, **fields: Any) -> StudioError:
    return StudioError("settings.not_yaml", problem, file=path, fix=_FIX, **fields)


def _plain(value: Any) -> Any:
    """A value without ruamel's own types, for comparing."""
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if isinstance(value, bool) or value is None:
        return value
    if isinstance(value, int):
        return int(value)
    if isinstance(value, float):
        return float(value)
    return str(value)
