"""From a YAML file and command-line overrides to a `Config`, with errors a user can act on."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import yaml
from pydantic import BaseModel, ValidationError

from pipelines.config.renamed import first_tree, renamed, renamed_override, tell
from pipelines.config.sections import Config
from studio.errors import StudioError
from studio.paths import need_utf8


class _Loader(yaml.SafeLoader):
    """YAML's safe loader that refuses a key written twice and reads 1e-3 as a number (YAML 1.2, as users expect)."""

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:
        try:
            return super().construct_object(node, deep=deep)
        except (ValueError, KeyError):  # 2026-02-30, or !!int with something else behind it
            kind = {"timestamp": "date", "bool": "truth value"}.get(str(node.tag).rpartition(":")[2], "number")
            raise yaml.constructor.ConstructorError(
                None, None, f"'{node.value}' is no {kind} though it is written as one", node.start_mark
            ) from None

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen: set[Any] = set()
        for key_node, _ in node.value:
            key = self.construct_object(key_node, deep=True)
            if isinstance(key, str) and key in seen:
                raise yaml.constructor.ConstructorError(
                    None, None, f"the key '{key}' is written twice", key_node.start_mark
                )
            if isinstance(key, str):
                seen.add(key)
        return super().construct_mapping(node, deep=deep)


def _number(loader: yaml.SafeLoader, node: yaml.ScalarNode) -> float:
    return float(node.value)


_Loader.add_implicit_resolver("!float12", re.compile(r"^[-+]?\d+(\.\d*)?[eE][-+]?\d+$"), list("-+0123456789"))
_Loader.add_constructor("!float12", _number)


def parse_override(text: str) -> tuple[str, Any]:
    """`train.max-splats=20000` to ("train.max_splats", 20000); the value is read as YAML.

    Raises:
        StudioError: there is no '=', no section, or the value is no YAML.
    """
    name, equals, value = text.partition("=")
    name = name.strip().replace("-", "_")
    if not equals or "." not in name:
        raise StudioError(f"'{text}' is not a setting; write section.name=value, as in train.max_splats=20000.")
    try:
        return name, yaml.load(value, Loader=_Loader)  # a SafeLoader
    except yaml.YAMLError:
        raise StudioError(f"The value of {name}, '{value}', cannot be read; quote it if it is text.") from None


def load_config(path: Path | None, overrides: Iterable[tuple[str, Any]] = ()) -> Config:
    """Read and check a configuration.

    Args:
        path: YAML file; None takes the defaults. Relative `capture.root` is relative to this file's folder.
        overrides: (dotted name, value) pairs, later ones win; a relative `capture.root` is relative to the working
            folder.

    Raises:
        StudioError: the file cannot be read, a key is unknown or a value impossible.
    """
    values: dict[str, Any] = {}
    if path is not None:
        values, changes = renamed(read_yaml(path), str(path))
        tell(str(path), changes)
        _anchor_root(values, path.parent, str(path))
    origin: dict[str, str] = {}
    for given, given_value in overrides:
        name, value, changes = renamed_override(given, given_value)
        tell("the command line", changes)
        *sections, last = name.split(".")
        target = values
        for section in sections:
            found = target.setdefault(section, {})
            if not isinstance(found, dict):
                raise StudioError(f"--{name}: '{section}' has no settings of its own.{_nearest_sentence(name)}")
            target = found
        target[last] = value
        origin[name] = "the command line"
        if name == "capture.root":
            _anchor_root(values, Path.cwd(), "the command line")
    try:
        return Config.model_validate(values)
    except ValidationError as error:
        raise StudioError(_explain(error, path, origin)) from None


def read_yaml(path: Path) -> dict[str, Any]:
    """The mapping in a YAML file (an empty file is an empty mapping).

    Raises:
        StudioError: not there, not readable, not YAML, or not a mapping of sections.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise StudioError(f"{path}: there is no such file; give the path of a YAML configuration.") from None
    except IsADirectoryError:
        raise StudioError(f"{path} is a folder; give the path of a YAML configuration.") from None
    except (OSError, UnicodeDecodeError) as error:
        raise StudioError(f"{path}: cannot be read ({error}); give a YAML file of settings.") from None
    try:
        values = yaml.load(text, Loader=_Loader)  # a SafeLoader
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f", line {mark.line + 1}" if mark is not None else ""
        raise StudioError(f"{path}{where}: {getattr(error, 'problem', None) or 'not YAML'}; mend the file.") from None
    if values is None:
        return {}
    if not isinstance(values, dict):
        raise StudioError(f"{path}: expected sections such as 'capture:' and 'train:', found {type(values).__name__}.")
    # "train:" with everything under it commented out is an empty section
    return {name: {} if value is None else value for name, value in values.items()}


def dump_config(config: Config) -> str:
    """YAML that `load_config` reads back to the same settings."""
    return dump_tree(config.model_dump(mode="json"))


def digest_text(config: Config) -> str:
    """The same with the names that settings had first: what stays the same when a setting is renamed."""
    return dump_tree(first_tree(config.model_dump(mode="json")))


def dump_tree(tree: dict[str, Any]) -> str:
    """YAML of sections of settings."""
    return yaml.safe_dump(tree, sort_keys=False, allow_unicode=True, width=120)


def _anchor_root(values: dict[str, Any], folder: Path, where: str) -> None:
    """Make `capture.root` absolute, seen from `folder`. Raises StudioError where it can be no path."""
    capture = values.get("capture")
    if isinstance(capture, dict) and isinstance(capture.get("root"), str):
        try:
            root = Path(capture["root"]).expanduser()
            root = root if root.is_absolute() else (folder.absolute() / root).resolve()
            capture["root"] = str(root)
        except (ValueError, RuntimeError) as error:  # a NUL in it, a user that is not there
            raise StudioError(
                f"{where}: capture.root = {capture['root']!r} can be no folder ({error}); give that of the footage."
            ) from None
        need_utf8(root)


def all_names(model: type[BaseModel] = Config, prefix: str = "") -> Iterator[str]:
    """Dotted names of all settings (leaves only)."""
    for name, field in model.model_fields.items():
        if isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel):
            yield from all_names(field.annotation, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}"


def nearest_name(name: str) -> str | None:
    """The known setting or section nearest to a dotted name, or None where nothing is near."""
    known = list(all_names())
    sections = {known_name.rsplit(".", 1)[0] for known_name in known}
    if "." not in name:
        near = difflib.get_close_matches(name, sorted(sections), n=1, cutoff=0.5)
        if near:
            return near[0]
    # the same last part in another section is what is mostly meant; else the whole name decides
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
    return f" The nearest is {near}." if near else " `v3studio config` prints them all."


def _explain(error: ValidationError, path: Path | None, origin: Mapping[str, str]) -> str:
    """One sentence a mistake: file, name, value found, mend."""
    sentences = []
    for problem in error.errors():
        location = [str(part) for part in problem["loc"]]
        name = ".".join(location)
        setting = next((".".join(location[:n]) for n in range(len(location), 0, -1) if _known(location[:n])), name)
        where = origin.get(setting) or origin.get(name) or (str(path) if path else "the settings")
        if name and any(given.startswith(f"{name}.") for given in origin):  # a rule over several settings
            where = f"{where} with the command line"
        kind, found = problem["type"], problem.get("input")
        if kind == "extra_forbidden":
            sentences.append(f"{where}: {name} is not a setting.{_nearest_sentence(name)}")
        elif kind == "value_error":
            sentences.append(f"{where}: {name}: {problem['ctx']['error']}{_found(found)}.")
        elif kind in ("model_type", "model_attributes_type"):
            sentences.append(f"{where}: {name} = {found!r} must be a section with settings of its own.")
        else:
            message = problem["msg"].replace("Input should", "must", 1)
            sentences.append(f"{where}: {name} = {_plain(found)} {message}.")
    return "\n".join(sentences)


def _known(location: list[str]) -> bool:
    return ".".join(location) in set(all_names())


def _found(value: Any) -> str:
    return f" (found {value!r})" if isinstance(value, (str, int, float)) else ""


def _plain(value: Any) -> str:
    return f"'{value}'" if isinstance(value, str) else repr(value)
