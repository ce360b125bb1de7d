"""Reads settings from a YAML file and the command line; errors say what to fix."""

import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any, get_args, get_origin

from pydantic import ValidationError
from pydantic.fields import FieldInfo

from v3studio.pipelines.config.config import Config
from v3studio.studio.bounded_files import TextError, need_utf8, read_bounded_text
from v3studio.studio.errors import StudioError, reason_of
from v3studio.studio.json_types import JsonObject
from v3studio.studio.settings import COMMAND_LINE, OVERRIDES, field_named, is_list_of_text, nearest_sentence, refused
from v3studio.studio.storage import is_address
from v3studio.studio.yaml_text import dump_yaml, parse_yaml


def parse_override(text: str) -> tuple[str, Any]:
    """`train.max-splats=20000` to ("train.max_splats", 20000); the value is parsed as YAML. Text needs no quotes,
    `capture.images={camera}/video.avi`, nor do items of a list of text: `capture.held_out=01,02` are two cameras."""
    name, equals, value = text.partition("=")
    name = name.strip().replace("-", "_")
    if not equals or "." not in name:
        problem = f"'{text}' is not of the form section.name=value"
        fix = "Example: train.max_splats=20000."
        raise StudioError("settings.override_syntax", problem, file=COMMAND_LINE, value=text, fix=fix)
    field = field_named(Config, name)
    text_only = _is_text(field)
    try:
        parsed = parse_yaml(value)
        if parsed is not None and is_list_of_text(field):
            return name, parse_yaml(value, plain=True)
        return name, parsed if not text_only or parsed is None or isinstance(parsed, str) else value.strip()
    except TextError:
        if text_only:
            return name, value.strip()
        problem = f"the value of {name}, '{value}', is not valid YAML"
        fix = "Quote it if it is text."
        raise StudioError("settings.override_syntax", problem, value=value, fix=fix, setting=name) from None


def _is_text(field: FieldInfo | None) -> bool:
    """Return whether a setting can only be text (or null)."""
    annotation = field.annotation if field is not None else None
    return annotation in (str, Path) or set(get_args(annotation)) == {str, type(None)}


def load_config(path: Path | str | None, overrides: Iterable[tuple[str, Any]] = ()) -> Config:
    """Settings of a YAML file (None: the defaults) with (dotted name, value) overrides, of which later ones win.

    Example:
        >>> config = v3.load_config("my-take/config.yaml", {"bake.quality": 24}.items())
        >>> config.bake.quality, config.capture.fps
        (24, 25.0)

    A relative `capture.root` is relative to the file's folder, in an override to the working directory. StudioError if
    the file cannot be read (see `read_yaml`), a setting is unknown (`settings.unknown`) or invalid
    (`settings.invalid`).
    """
    path = None if path is None else Path(path)
    values: JsonObject = {}
    if path is not None:
        values = read_yaml(path)
        _anchor_root(values, path.parent, str(path))
    given: set[str] = set()
    for name, value in overrides:
        *sections, last = name.split(".")
        target = values
        for section in sections:
            inner = target.setdefault(section, {})
            if not isinstance(inner, dict):
                problem = f"unknown setting {name}: {section} is not a section"
                fix = nearest_sentence(Config, name)
                raise StudioError("settings.unknown", problem, file=OVERRIDES, value=value, fix=fix, setting=name)
            target = inner
        target[last] = value
        given.add(name)
        if name == "capture.root":
            _anchor_root(values, Path.cwd(), OVERRIDES)
    try:
        return Config.model_validate(values)
    except ValidationError as error:
        raise refused(error, Config, path or OVERRIDES, given) from None


def read_yaml(path: Path) -> JsonObject:
    """The sections in a YAML file; an empty file has none."""
    fix = "Specify a YAML file of settings."
    try:
        text = read_bounded_text(path)
    except FileNotFoundError:
        raise StudioError("settings.file_not_found", "no such file", file=path, fix=fix) from None
    except IsADirectoryError:
        raise StudioError("settings.unreadable", "is a folder", file=path, fix=fix) from None
    except (OSError, UnicodeDecodeError) as error:
        raise StudioError("settings.unreadable", f"cannot be read ({reason_of(error)})", file=path, fix=fix) from None
    try:
        tree, plain = parse_yaml(text), parse_yaml(text, plain=True)
    except TextError as error:
        fix = _quotes(text, error.line)
        raise StudioError("settings.not_yaml", str(error), file=path, fix=fix, line=error.line) from None
    if tree is None:
        return {}
    if not isinstance(tree, dict):
        problem = f"expected sections such as 'capture:' and 'train:', found {type(tree).__name__}"
        raise StudioError("settings.not_yaml", problem, file=path, fix="Indent settings under their section.")
    # "train:" with everything under it commented out is an empty section
    return {name: {} if value is None else _as_written(name, value, plain.get(name)) for name, value in tree.items()}


def _as_written(section: str, values: Any, plain: Any) -> Any:
    """The values of a section, with text where settings are text: the camera 04 is not the number 4."""
    if not isinstance(values, dict) or not isinstance(plain, dict) or len(plain) != len(values) or "<<" in plain:
        return values
    written = {}
    for (name, value), text in zip(values.items(), plain.values(), strict=True):
        field = field_named(Config, f"{section}.{name}")
        if is_list_of_text(field) or _is_text(field):
            written[name] = _texts(value, text)
        elif get_origin(getattr(field, "annotation", None)) is dict and isinstance(value, dict):
            written[name] = dict(zip(text, value.values(), strict=True))
        else:
            written[name] = value
    return written


def _texts(value: Any, text: Any) -> Any:
    """The text of values other than null, in nested lists."""
    if isinstance(value, list):
        return [_texts(*both) for both in zip(value, text, strict=True)]
    return text if isinstance(value, (bool, int, float)) else value


def _quotes(text: str, line: int | None) -> str:
    """Advice on a YAML error: a pattern that begins with a brace needs quotes, and so does 60: for frames."""
    lines = text.splitlines()
    for number in (line or 0, (line or 0) - 1):  # YAML may notice at the next line
        pattern = r"\s*(\w+):\s*(\{(?:camera|frame)[^#]*|\d*:\s*$)"
        unquoted = re.match(pattern, lines[number - 1]) if 0 < number <= len(lines) else None
        if unquoted:
            return f"Put the value in quotes: {unquoted[1]}: '{unquoted[2].strip()}'."
    return "Fix the file."


def dump_config(config: Config) -> str:
    """YAML that `load_config` reads back as the same settings."""
    return dump_yaml(config.model_dump(mode="json"))


def _anchor_root(values: JsonObject, folder: Path, where: str) -> None:
    """Make `capture.root` absolute, relative to `folder`. Raises StudioError if it cannot be a path."""
    capture = values.get("capture")
    if isinstance(capture, dict) and isinstance(capture.get("root"), str):
        if is_address(capture["root"]):
            return
        try:
            root = Path(capture["root"]).expanduser()
            root = root if root.is_absolute() else (folder.absolute() / root).resolve()
            capture["root"] = str(root)
        except (ValueError, RuntimeError) as error:  # a NUL character, an unknown user
            problem = f"capture.root = {capture['root']!r} is not a valid path ({error})"
            fix = "Set it to the folder of the footage."
            raise StudioError(
                "settings.invalid", problem, file=where, value=capture["root"], fix=fix, setting="capture.root"
            ) from None
        need_utf8(root)
