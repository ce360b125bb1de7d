"""Violated rules of pydantic models in the words of this program's messages."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

_WORDS = {
    "missing": "is missing",
    "extra_forbidden": "is not known",
    "int_type": "must be a whole number",
    "int_parsing": "must be a whole number",
    "int_from_float": "must be a whole number",
    "float_type": "must be a number",
    "float_parsing": "must be a number",
    "finite_number": "must be finite",
    "bool_type": "must be true or false",
    "bool_parsing": "must be true or false",
    "string_type": "must be text",
    "path_type": "must be a path",
    "tuple_type": "must be a list",
    "list_type": "must be a list",
    "dict_type": "must be name: value pairs",
    "model_type": "must be name: value pairs",
    "model_attributes_type": "must be name: value pairs",
}
_BOUNDS = {
    "greater_than": ("gt", "above"),
    "greater_than_equal": ("ge", "at least"),
    "less_than": ("lt", "below"),
    "less_than_equal": ("le", "at most"),
}


def violation(problem: Mapping[str, Any]) -> str:
    """What a value must be ("must be at most 51"), from an entry of `pydantic.ValidationError.errors()`."""
    kind, details = problem["type"], problem.get("ctx", {})
    if kind in _WORDS:
        return _WORDS[kind]
    if kind in _BOUNDS:
        key, words = _BOUNDS[kind]
        bound = details[key]
        return f"must be {words} {int(bound) if bound == int(bound) else bound}"
    if kind in ("too_short", "too_long"):
        key, words = ("min_length", "at least") if kind == "too_short" else ("max_length", "at most")
        count = details[key]
        return f"must have {words} {count} {'entry' if count == 1 else 'entries'}"
    if kind == "literal_error":
        return f"must be {details['expected'].replace(chr(39), '')}"
    return str(problem["msg"]).removeprefix("Value error, ").replace("Input should", "must", 1)
