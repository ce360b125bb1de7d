"""YAML as all files of this program use it: read, checked and written with ruamel.yaml.

Plain values mean what they mean in YAML 1.1 (yes and off are Booleans, 010 is octal, 1:30 is 90), since files of
earlier versions were read that way, and 1e-3 is a number as in YAML 1.2. Duplicate keys are errors.
"""

from __future__ import annotations

import io
import re
import warnings
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.constructor import BaseConstructor, ConstructorError, RoundTripConstructor, SafeConstructor
from ruamel.yaml.error import MantissaNoDotYAML1_1Warning, YAMLError
from ruamel.yaml.resolver import VersionedResolver

from studio.bounded_files import Bounds, TextError, check_depth, check_text, check_value

_VERSION = (1, 1)
BOUNDS = Bounds(size=4 << 20, values=200_000)
"""Smaller than for JSON: a megabyte takes about 20 s to parse, and settings and points have kilobytes."""
_TAGS = (
    ("bool", r"yes|Yes|YES|no|No|NO|true|True|TRUE|false|False|FALSE|on|On|ON|off|Off|OFF", "yYnNtTfFoO"),
    (
        "float",
        r"[-+]?[0-9][0-9_]*\.[0-9_]*(?:[eE][-+][0-9]+)?|\.[0-9][0-9_]*(?:[eE][-+][0-9]+)?"
        r"|[-+]?[0-9][0-9_]*(?::[0-5]?[0-9])+\.[0-9_]*|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN)"
        r"|[-+]?\d+(?:\.\d*)?[eE][-+]?\d+",  # the last as in YAML 1.2
        "-+0123456789.",
    ),
    (
        "int",
        r"[-+]?0b[01_]+|[-+]?0[0-7_]+|[-+]?(?:0|[1-9][0-9_]*)|[-+]?0x[0-9a-fA-F_]+|[-+]?[1-9][0-9_]*(?::[0-5]?[0-9])+",
        "-+0123456789",
    ),
    ("merge", "<<", "<"),
    ("null", "~|null|Null|NULL|", ("~", "n", "N", "")),
    (
        "timestamp",
        r"\d\d\d\d-\d\d-\d\d|\d\d\d\d-\d\d?-\d\d?(?:[Tt]|[ \t]+)\d\d?:\d\d:\d\d(?:\.\d*)?"
        r"(?:[ \t]*(?:Z|[-+]\d\d?(?::\d\d)?))?",
        "0123456789",
    ),
    ("value", "=", "="),
)
"""Tags of plain values by their text, the first that matches, with the characters that it may begin with."""


class YamlError(ValueError):
    """Text that is not YAML.

    Attributes:
        problem: what is wrong, without the line.
        line: counted from 1; None if unknown.
    """

    def __init__(self, problem: str, line: int | None) -> None:
        super().__init__(problem if line is None else f"line {line}: {problem}")
        self.problem, self.line = problem, line


class DuplicateKey(YamlError):
    """A mapping has a key twice.

    Attributes:
        key: the key.
        mapping_line: line that the mapping begins in.
    """

    def __init__(self, key: str, line: int, mapping_line: int) -> None:
        super().__init__(f"duplicate key '{key}'", line)
        self.key, self.mapping_line = key, mapping_line


class Resolver(VersionedResolver):
    """Which plain values are numbers, Booleans, ...; see the module."""

    _tables: dict[str, list[tuple[str, re.Pattern[str]]]] = {}  # noqa: RUF012  # filled below

    @property
    def versioned_resolver(self) -> Any:
        return self._tables

    @property
    def processing_version(self) -> Any:
        return _VERSION


for _tag, _pattern, _begins in _TAGS:
    for _begin in _begins:
        Resolver._tables.setdefault(_begin, []).append((f"tag:yaml.org,2002:{_tag}", re.compile(f"(?:{_pattern})\\Z")))


class _RefusesDuplicates:
    def check_mapping_key(self, node: Any, key_node: Any, mapping: Any, key: Any, value: Any) -> bool:
        if isinstance(key, str) and key in mapping:
            raise DuplicateKey(key, key_node.start_mark.line + 1, node.start_mark.line + 1)
        return True


class _TakesFloats:
    def construct_yaml_float(self, node: Any) -> Any:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", MantissaNoDotYAML1_1Warning)  # 1e-3 is meant
            return super().construct_yaml_float(node)  # type: ignore[misc]


class _Constructor(_RefusesDuplicates, _TakesFloats, SafeConstructor):
    def construct_object(self, node: Any, deep: bool = False) -> Any:
        try:
            return super().construct_object(node, deep=deep)
        except YamlError:
            raise
        except (ValueError, LookupError, AttributeError, AssertionError):  # 2026-02-30, or !!int followed by text
            kind = {"timestamp": "date", "bool": "Boolean"}.get(str(node.tag).rpartition(":")[2], "number")
            shown = node.value if len(node.value) <= 60 else f"{node.value[:59]}…"
            problem = f"'{shown}' is not a valid {kind}"
            raise ConstructorError(None, None, problem, node.start_mark) from None


class _CommentsConstructor(_TakesFloats, RoundTripConstructor):
    pass


for _class in (_Constructor, _CommentsConstructor):
    _class.add_constructor("tag:yaml.org,2002:float", _class.construct_yaml_float)


class _TextConstructor(_RefusesDuplicates, BaseConstructor):
    """Every value is text."""


def parse_yaml(text: str, *, plain: bool = False) -> Any:
    """The value of a YAML document; None if it is empty.

    Args:
        text: the document.
        plain: leave every value as the text that it is, so that 01 does not become 1.

    Raises:
        YamlError: it is not YAML; `DuplicateKey` for a key that a mapping has twice.
    """
    reader = YAML(typ="safe", pure=True)
    reader.Resolver = Resolver
    reader.Constructor = _TextConstructor if plain else _Constructor
    return _read(reader, text)


def parse_with_comments(text: str) -> Any:
    """The same as a tree that keeps comments, quotes and order for `dump_with_comments`."""
    return _read(_with_comments(), text)


def dump_yaml(value: Any, *, flow: bool | None = False, width: int = 120) -> str:
    """YAML that `parse_yaml` reads as the same JSON-ready value; keys stay in order.

    Args:
        value: JSON-ready.
        flow: whether lists and mappings are in brackets; None: those that hold no other ones.
        width: where lines are broken.
    """
    writer = YAML(typ="safe", pure=True)
    writer.Resolver = Resolver
    writer.default_flow_style = flow
    writer.width = width
    writer.allow_unicode = True
    writer.sort_base_mapping_type_on_output = False  # type: ignore[assignment]
    writer.version = _VERSION  # so that it quotes what YAML 1.1 needs quoted; it says so in front
    return re.sub(r"\A%YAML 1\.1\n---[ \n]", "", _written(writer, value))


def inline_yaml(value: Any) -> str:
    """A value on one line."""
    return dump_yaml(value, flow=True, width=10**6).removesuffix("...\n").strip()


def dump_with_comments(tree: Any) -> str:
    """YAML of a tree that `parse_with_comments` made."""
    return _written(_with_comments(), tree)


def _with_comments() -> YAML:
    yaml = YAML()
    yaml.Resolver = Resolver
    yaml.Constructor = _CommentsConstructor
    yaml.preserve_quotes = True
    yaml.width = 120
    yaml.allow_unicode = True
    return yaml


def _read(reader: YAML, text: str) -> Any:
    try:
        check_text(text, BOUNDS)
        check_depth(text, BOUNDS)
        value = reader.load(text)
        check_value(value, BOUNDS)
        return value
    except YamlError:
        raise
    except TextError as error:
        raise YamlError(str(error), None) from None
    except RecursionError:
        raise YamlError(f"nested more than {BOUNDS.depth} levels deep", None) from None
    except (YAMLError, ValueError) as error:
        mark = getattr(error, "problem_mark", None)
        problem = getattr(error, "problem", None) or getattr(error, "reason", None) or "not valid YAML"
        raise YamlError(problem, None if mark is None else mark.line + 1) from None


def _written(writer: YAML, value: Any) -> str:
    text = io.StringIO()
    writer.dump(value, text)
    return text.getvalue()
