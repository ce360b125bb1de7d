"""Changes a value in a YAML file of settings and keeps its comments and the order of its keys."""

import contextlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from v3studio.pipelines.config.config import Config, values_of
from v3studio.pipelines.config.loading import dump_config, load_config, read_yaml
from v3studio.studio.atomic_files import write_text
from v3studio.studio.bounded_files import TextError, read_bounded_text
from v3studio.studio.errors import StudioError, reason_of
from v3studio.studio.yaml_text import dump_with_comments, parse_with_comments, parse_yaml

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
    """The text that `set_settings` writes, with its errors; None if all values are there already."""
    try:
        tree = _parse(read_bounded_text(path) if path.exists() else "", path)
    except (OSError, UnicodeDecodeError) as error:
        raise StudioError("settings.unreadable", f"cannot be read ({reason_of(error)})", file=path, fix=_FIX) from None
    changed = not path.exists()
    for name, value in values.items():
        *sections, last = name.split(".")
        target = tree
        for section in sections:
            inner = target.get(section)
            if not isinstance(inner, dict):
                inner = target[section] = type(tree)()
            target = inner
        if last not in target or json.loads(json.dumps(target[last], default=str)) != value:
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
            set_settings(path, values_of(config))
            if load_config(path) == config:
                return
    write_text(path, dump_config(config))


def _parse(text: str, path: Path) -> Any:
    from ruamel.yaml.comments import CommentedMap

    try:
        parse_yaml(text)  # refuses what contains itself, which the tree would silently leave out
        tree = parse_with_comments(text)
    except TextError as error:
        raise StudioError("settings.not_yaml", str(error), file=path, fix=_FIX, line=error.line) from None
    if tree is None:
        return CommentedMap()
    if not isinstance(tree, CommentedMap):
        problem = "expected sections such as 'capture:' and 'train:'"
        raise StudioError("settings.not_yaml", problem, file=path, fix=_FIX)
    return tree
