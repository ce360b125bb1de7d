"""YAML as all files of this program use it: read, checked and written with ruamel.yaml.

Plain values mean what they mean in YAML 1.2: 1e-3 is a number, and yes and off are text, which settings that are
true or false accept. Duplicate keys are errors.
"""

import copy
import functools
import io
import re
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.constructor import ConstructorError, DuplicateKeyError, SafeConstructor
from ruamel.yaml.error import YAMLError
from ruamel.yaml.representer import SafeRepresenter

from v3studio.studio.bounded_files import Bounds, TextError, check_depth, check_text, check_value, too_deep

BOUNDS = Bounds(size=4 << 20, values=200_000)
"""Smaller than for JSON: a megabyte takes about 20 s to parse, and settings and points have kilobytes."""


class _Constructor(SafeConstructor):
    def construct_object(self, node: Any, deep: bool = False) -> Any:
        try:
            return super().construct_object(node, deep=deep)
        except YAMLError:
            raise
        except (ValueError, LookupError, AttributeError, AssertionError):  # 2026-02-30, or !!int followed by text
            raise ConstructorError(None, None, f"'{node.value:.60}' is not a valid value", node.start_mark) from None


class _Representer(SafeRepresenter):
    def represent_str(self, data: str) -> Any:
        # in brackets, ruamel writes text that begins with these without quotes, and reads it as a key or a value
        return self.represent_scalar("tag:yaml.org,2002:str", data, style="'" if data.startswith((":", "?")) else None)


_Representer.add_representer(str, _Representer.represent_str)


def parse_yaml(text: str, *, plain: bool = False) -> Any:
    """The value of a YAML document; None if it is empty. `plain`: leave every value as the text that it is, so that 01
    does not become 1. TextError if it is not YAML, or a mapping has a key twice."""
    return copy.deepcopy(_parsed(text, plain))


@functools.lru_cache(maxsize=32)  # a run reads its settings several times, which takes 10 ms each
def _parsed(text: str, plain: bool) -> Any:
    reader = YAML(typ="base" if plain else "safe", pure=True)
    if not plain:
        reader.Constructor = _Constructor
    return _read(reader, text)


def parse_with_comments(text: str) -> Any:
    """Parse a text to a tree that keeps comments, quotes and order for `dump_with_comments`."""
    return _read(_with_comments(), text)


def dump_yaml(value: Any, *, flow: bool | None = False, width: int = 120) -> str:
    """YAML that `parse_yaml` reads as the same JSON-ready value; keys stay in order. `flow`: whether lists and mappings
    are in brackets; None: those that hold no other ones."""
    writer = YAML(typ="safe", pure=True)
    writer.Representer = _Representer
    writer.default_flow_style = flow
    writer.width = width
    writer.allow_unicode = True
    writer.sort_base_mapping_type_on_output = False  # type: ignore[assignment]
    return _written(writer, value)


def inline_yaml(value: Any) -> str:
    """A value on one line."""
    return dump_yaml(value, flow=True, width=10**6).removesuffix("...\n").strip()


def dump_with_comments(tree: Any) -> str:
    """YAML of a tree that `parse_with_comments` made."""
    return _written(_with_comments(), tree)


def _with_comments() -> YAML:
    yaml = YAML()
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
    except RecursionError:
        raise too_deep(BOUNDS) from None
    except YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        problem = str(getattr(error, "problem", None) or getattr(error, "reason", None) or "not valid YAML")
        if isinstance(error, DuplicateKeyError):  # which also quotes both values
            problem = re.sub(r'^found (duplicate key) "(.*?)".*', r"\1 '\2'", problem, flags=re.DOTALL)
        line = None if mark is None else mark.line + 1
        problem = problem[:200]  # it may quote names of any length
        raise TextError(problem if line is None else f"line {line}: {problem}", line) from None


def _written(writer: YAML, value: Any) -> str:
    text = io.StringIO()
    writer.dump(value, text)
    return text.getvalue()
