"""Reads settings from a YAML file and the command line; errors say what to fix."""

from __future__ import annotations

import difflib
import json
import re
from collections.abc import Collection, Iterable, Iterator
from pathlib import Path
from typing import Any, get_args, get_origin

from pydantic import ValidationError
from pydantic.fields import FieldInfo

from pipelines.config.config import Config
from studio.bounded_files import need_utf8, read_bounded_text
from studio.errors import Message, StudioError, reason_of, violation
from studio.json_types import JsonObject
from studio.settings import Conflict, Settings, is_list_of_text, submodel
from studio.storage import is_address
from studio.yaml_text import YamlError, dump_yaml, parse_yaml

COMMAND_LINE = "command line"
"""Named in place of a file in errors about overrides."""


def parse_override(text: str) -> tuple[str, Any]:
    """`train.max-splats=20000` to ("train.max_splats", 20000); the value is parsed as YAML.

    The value of a setting that is text needs no quotes: `capture.images={camera}/video.avi`. Nor do the items of a list
    of text: `capture.held_out=01,02` names the cameras 01 and 02.

    Raises:
        StudioError: no '=', no section, or the value is not YAML (`settings.override_syntax`).
    """
    name, equals, value = text.partition("=")
    name = name.strip().replace("-", "_")
    if not equals or "." not in name:
        raise StudioError(
            "settings.override_syntax",
            f"'{text}' is not of the form section.name=value",
            value=text,
            fix="Example: train.max_splats=20000.",
        )
    field = _field(name)
    text_only = _is_text(field)
    try:
        parsed = parse_yaml(value)
        if parsed is not None and is_list_of_text(field):
            return name, parse_yaml(value, plain=True)
        return name, parsed if not text_only or parsed is None or isinstance(parsed, str) else value.strip()
    except YamlError:
        if text_only:
            return name, value.strip()
        raise StudioError(
            "settings.override_syntax",
            f"the value of {name}, '{value}', is not valid YAML",
            value=value,
            fix="Quote it if it is text.",
            setting=name,
        ) from None


def _field(name: str) -> FieldInfo | None:
    """The field of a setting; None if there is no such setting."""
    field, model = None, Config
    for part in name.split("."):
        field = model.model_fields.get(part) if model is not None else None
        if field is None:
            return None
        model = submodel(field)  # type: ignore[assignment]
    return field


def _is_text(field: FieldInfo | None) -> bool:
    """Whether a setting can only be text (or null)."""
    annotation = field.annotation if field is not None else None
    return annotation in (str, Path) or set(get_args(annotation)) == {str, type(None)}


def load_config(path: Path | str | None, overrides: Iterable[tuple[str, Any]] = ()) -> Config:
    """Read and validate settings.

    Args:
        path: YAML file; None: the defaults. A relative `capture.root` is relative to this file's folder.
        overrides: (dotted name, value) pairs; later ones win. A relative `capture.root` is relative to the working
            directory.

    Raises:
        StudioError: the file cannot be read (see `read_yaml`), a setting is unknown (`settings.unknown`) or has an
            invalid value (`settings.invalid`).
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
            found = target.setdefault(section, {})
            if not isinstance(found, dict):
                raise StudioError(
                    "settings.unknown",
                    f"unknown setting {name}: {section} is not a section",
                    file=COMMAND_LINE,
                    value=value,
                    fix=_nearest_sentence(name),
                    setting=name,
                )
            target = found
        target[last] = value
        given.add(name)
        if name == "capture.root":
            _anchor_root(values, Path.cwd(), COMMAND_LINE)
    try:
        return Config.model_validate(values)
    except ValidationError as error:
        raise refused(error, path, given=given) from None


def read_yaml(path: Path) -> JsonObject:
    """The sections in a YAML file; an empty file has none.

    Raises:
        StudioError: `settings.file_not_found`, `settings.unreadable`, or not YAML or not sections
            (`settings.not_yaml`).
    """
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
        values, plain = parse_yaml(text), parse_yaml(text, plain=True)
    except YamlError as error:
        raise StudioError(
            "settings.not_yaml", str(error), file=path, fix=_quotes(text, error.line), line=error.line
        ) from None
    if values is None:
        return {}
    if not isinstance(values, dict):
        raise StudioError(
            "settings.not_yaml",
            f"expected sections such as 'capture:' and 'train:', found {type(values).__name__}",
            file=path,
            fix="Indent settings under their section.",
        )
    # "train:" with everything under it commented out is an empty section
    return {name: {} if value is None else _as_written(name, value, plain.get(name)) for name, value in values.items()}


def _as_written(section: str, values: Any, plain: Any) -> Any:
    """The values of a section, with text where settings are text: the camera 04 is not the number 4."""
    if not isinstance(values, dict) or not isinstance(plain, dict) or len(plain) != len(values) or "<<" in plain:
        return values
    written = {}
    for (name, value), text in zip(values.items(), plain.values(), strict=True):
        field = _field(f"{section}.{name}")
        is_value = isinstance(value, (int, float))
        if (is_list_of_text(field) and isinstance(value, list)) or (_is_text(field) and is_value):
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
    """What to do about a YAML error: a pattern that begins with a brace needs quotes, and so does 60: for frames."""
    lines = text.splitlines()
    for number in (line or 0, (line or 0) - 1):  # YAML may notice at the next line
        pattern = r"\s*(\w+):\s*(\{(?:camera|frame)[^#]*|\d*:\s*$)"
        found = re.match(pattern, lines[number - 1]) if 0 < number <= len(lines) else None
        if found:
            return f"Put the value in quotes: {found[1]}: '{found[2].strip()}'."
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
            raise StudioError(
                "settings.invalid",
                f"capture.root = {capture['root']!r} is not a valid path ({error})",
                file=where,
                value=capture["root"],
                fix="Set it to the folder of the footage.",
                setting="capture.root",
            ) from None
        need_utf8(root)


def all_names(model: type[Settings] = Config, prefix: str = "") -> Iterator[str]:
    """Dotted names of all settings (leaves only)."""
    for name, field in model.model_fields.items():
        inner = submodel(field)
        if inner is not None:
            yield from all_names(inner, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}"


def nearest_name(name: str) -> str | None:
    """The known setting or section most similar to a dotted name; None if none is similar."""
    known = list(all_names())
    sections = {known_name.rsplit(".", 1)[0] for known_name in known}
    if "." not in name:
        near = difflib.get_close_matches(name, sorted(sections), n=1, cutoff=0.5)
        if near:
            return near[0]
    # the usual mistake is a correct name in the wrong section
    last = name.rsplit(".", 1)[-1]
    twins = [candidate for candidate in known if candidate.rsplit(".", 1)[-1] == last]
    if twins:
        return difflib.get_close_matches(name, twins, n=1, cutoff=0.0)[0]
    near = difflib.get_close_matches(name, known, n=1, cutoff=0.5)
    if near:
        return near[0]
    tails = {candidate.rsplit(".", 1)[-1]: candidate for candidate in known}
    near = difflib.get_close_matches(last, list(tails), n=1, cutoff=0.5)
    return tails[near[0]] if near else None


def _nearest_sentence(name: str) -> str:
    near = nearest_name(name)
    return f"Did you mean {near}?" if near else "`v3studio config` lists all settings."


def refused(
    error: ValidationError, file: Path | str | None, prefix: str = "", given: Collection[str] = ()
) -> StudioError:
    """Convert a pydantic error to a StudioError: one sentence per mistake, with file, setting, value and fix.

    Args:
        error: raised by a settings model.
        file: file that the settings come from, or a description of another source.
        prefix: dotted name of the model's section, with a dot at the end; "" for `Config`.
        given: dotted names of settings from the command line.

    Returns:
        `settings.unknown` or `settings.invalid`; for several mistakes `settings.invalid`, whose field `mistakes`
        contains each as `Message.to_dict()`.
    """
    mistakes = [_mistake(dict(problem), file, prefix, given) for problem in error.errors()]
    if len(mistakes) == 1:
        (one,) = mistakes
        return StudioError(one.code, one.problem, file=one.file, value=one.value, fix=one.fix, **one.fields)
    lines = "\n".join(str(mistake) for mistake in mistakes)
    return StudioError("settings.invalid", lines, mistakes=[mistake.to_dict() for mistake in mistakes])


def _mistake(problem: JsonObject, file: Path | str | None, prefix: str, given: Collection[str]) -> Message:
    location = [*filter(None, prefix.split(".")), *map(str, problem["loc"])]
    name = ".".join(location)
    known = set(all_names())
    setting = next(
        (".".join(location[:n]) for n in range(len(location), 0, -1) if ".".join(location[:n]) in known), name
    )
    where: Path | str = file or "settings"
    if setting in given or name in given:
        where = COMMAND_LINE
    elif any(one.startswith(f"{name}.") for one in given):  # a rule across several settings
        where = f"{where} and {COMMAND_LINE}" if file else COMMAND_LINE
    kind, found = problem["type"], problem.get("input")
    if kind == "extra_forbidden":
        return Message(
            "settings.unknown", f"unknown setting {name}", where, found, _nearest_sentence(name), {"setting": name}
        )
    fields: JsonObject = {"setting": setting}
    fix = ""
    cause = problem.get("ctx", {}).get("error")
    if isinstance(cause, Conflict):
        text, fix = cause.problem, cause.fix
        if cause.secret:
            text, found = f"{name} {text}", None
        elif cause.names:
            fields["settings"] = [f"{name}.{one}" for one in cause.names]
            text = f"{name}: {text}"
            found = None
        else:
            text = f"{name} = {_plain(found)} {'' if text.startswith('must') else 'is invalid: '}{text}"
    elif kind in ("model_type", "model_attributes_type"):
        text, fix = f"{name} = {found!r} is not a section", f"Indent settings under it, one per line ({name}: ...)."
    else:
        words = violation(problem)
        text = f"{name} = {_plain(found)} {'' if words.startswith(('must', 'is ')) else 'is invalid: '}{words}"
        fix = _default_sentence(setting)
    return Message("settings.invalid", text, where, found, fix, fields)


def _default_sentence(name: str) -> str:
    """What a setting is if nothing is said; "" for those of nested models."""
    value: Any = Config()
    for part in name.split("."):
        if not hasattr(value, part):
            return ""
        value = getattr(value, part)
    if isinstance(value, tuple):
        value = list(value)
    plain = all(isinstance(item, str | int | float | None) for item in (value if isinstance(value, list) else [value]))
    return f"The default is {json.dumps(value).strip(chr(34))}." if plain else ""


def _plain(value: Any) -> str:
    return f"'{value}'" if isinstance(value, str) else repr(value)
