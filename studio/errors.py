"""Errors and warnings for people and programs.

Every error and warning of the library is a `Message`: a stable dotted code, which programs and tests use, and a text
for people that names the file, the problem and the fix. The command line and the window show the text without a
traceback.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Self

from v3studio.studio.json_types import JsonObject

if TYPE_CHECKING:
    from pydantic import ValidationError

MAX_LENGTH = 2000
"""Maximum length of a text in characters. Longer ones are truncated, because they may contain file contents."""

_ENDS = (".", "!", "?", ":")
_BIDI = "\u061c\u200e\u200f\u202a-\u202e\u2066-\u2069"
_HIDDEN = re.compile(f"[\x00-\x1f\x7f-\x9f{_BIDI}]")
_HIDDEN_IN_LINES = re.compile(f"[\x00-\x08\x0b-\x1f\x7f-\x9f{_BIDI}]")


def plain_text(text: str) -> str:
    """Return one line of text without control and bidirectional characters, with which a title could look like another;
    white space becomes single spaces. Joiners, which emoji and some scripts need, stay."""
    return " ".join(_HIDDEN.sub("", " ".join(text.split())).split())


def visible(text: str) -> str:
    """Return text with a "?" for each control or bidirectional character, which could steer a terminal or make a file's
    name look like another; line breaks and tabs stay."""
    return _HIDDEN_IN_LINES.sub("?", text)


_SHOWN: dict[str, str] = {}


def show_as(prefix: str, shown_prefix: str) -> None:
    """Messages of this process name files whose path begins with `prefix`, a folder on this machine that holds copies,
    ending in a slash, by what the copies were made of, such as "s3://"."""
    _SHOWN[prefix] = shown_prefix


def shown(text: str) -> str:
    """A text or path as people know it; see `show_as`."""
    for prefix, shown_prefix in tuple(_SHOWN.items()):
        text = text.replace(prefix, shown_prefix)
    return text


@dataclass(frozen=True)
class Message:
    """An error or a warning, with everything needed to act on it.

    Attributes:
        code: identifies the kind of problem, as `area.what` in lower case with underscores ("footage.no_frames"). The
            meaning of a code never changes; the text may.
        problem: what is wrong, as a clause or sentence without the file's name ("no camera named cam9").
        file: the affected file or folder; None if there is none.
        value: the offending value, if there is one.
        fix: how to fix the problem, as a sentence ("Remove it from capture.held_out").
        fields: further details for programs: camera, frame, setting, line, expected, ...
    """

    code: str
    problem: str
    file: str | os.PathLike[str] | None = None
    value: Any = None
    fix: str = ""
    fields: Mapping[str, Any] = field(default_factory=dict)

    def __str__(self) -> str:
        """`FILE: problem. Fix.`, made `visible` and at most `MAX_LENGTH` characters long."""
        text = f"{os.fspath(self.file)}: {self.problem}" if self.file is not None else self.problem
        parts = [_sentence(part) for part in (text, self.fix) if part]
        text = visible(shown(" ".join(parts)))
        return text if len(text) <= MAX_LENGTH else text[: MAX_LENGTH - 1] + "…"

    def to_dict(self) -> JsonObject:
        """JSON-ready: `code`, `message` (the full text); `file`, `value` and `fix` if set; and the fields."""
        entries: JsonObject = {"code": self.code, "message": str(self)}
        if self.file is not None:
            entries["file"] = shown(os.fspath(self.file))
        if self.value is not None:
            entries["value"] = _plain(self.value)
        if self.fix:
            entries["fix"] = self.fix
        return entries | {name: _plain(value) for name, value in self.fields.items()}


class StudioError(Exception):
    """Invalid input: footage, calibration, settings, a take or a stream. `str(error)` is the text for the user; the
    parts of `message` are also attributes of the error."""

    def __init__(
        self,
        code: str,
        problem: str,
        *,
        file: str | os.PathLike[str] | None = None,
        value: Any = None,
        fix: str = "",
        **fields: Any,
    ) -> None:
        self.message = Message(code, problem, file, value, fix, fields)
        self.code, self.problem, self.file, self.value, self.fix = code, problem, file, value, fix
        self.fields: Mapping[str, Any] = fields
        super().__init__(code, problem)

    @classmethod
    def of(cls, message: Message) -> Self:
        """The error with this message."""
        known = {"file": message.file, "value": message.value, "fix": message.fix}
        return cls(message.code, message.problem, **known, **message.fields)

    def __str__(self) -> str:
        return str(self.message)

    def __reduce__(self) -> tuple[Any, ...]:
        # errors are passed between processes, and Exception's own pickling drops keyword arguments
        return type(self).of, (self.message,)


@contextmanager
def naming(file: str | os.PathLike[str]) -> Iterator[None]:
    """Context manager that adds the file to every StudioError raised inside it that does not have one."""
    try:
        yield
    except StudioError as error:
        if error.file is not None:
            raise
        raise type(error).of(replace(error.message, file=file)) from None


class Cancelled(Exception):
    """Raised by a `progress` callback to stop a long-running function."""


def _sentence(text: str) -> str:
    text = text.strip()
    return text if text.endswith(_ENDS) else f"{text}."


def _plain(value: Any) -> Any:
    """Convert a value to JSON types, limited in size so that the contents of a malicious file cannot flood a log."""
    if value is None or isinstance(value, (bool, int, float)):
        return value
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value[:100]]
    if isinstance(value, Mapping):
        return {str(name): _plain(item) for name, item in list(value.items())[:100]}
    text = os.fspath(value) if isinstance(value, os.PathLike) else str(value)
    return visible(text)[:MAX_LENGTH]


def reason_of(error: Exception) -> str:
    """The reason of an error as text; an OSError's without number and path ("not a directory")."""
    words = (error.strerror if isinstance(error, OSError) else None) or str(error) or type(error).__name__
    return words[:1].lower() + words[1:] if isinstance(error, OSError) else words


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
    """The rule that a value breaks ("must be at most 51"), from an entry of `pydantic.ValidationError.errors()`."""
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


def first_violation(error: ValidationError, whole: str = "the file") -> tuple[str, str]:
    """The dotted path of the first value that a model refuses, "" for the `whole`, and a clause with the value."""
    first = error.errors(include_url=False)[0]
    where, given, words = ".".join(map(str, first["loc"])), first["input"], violation(first)
    shown = where and words.startswith("must") and isinstance(given, str | int | float)
    return where, f"{where or whole}{f' = {given!r:.60}' if shown else ''} {words}"
