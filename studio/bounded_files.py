"""Files from outside of the program, read up to a size, and JSON and TOML parsed within bounds.

A file can be larger than memory and take no disk space. Parsers take whatever they are given: 100,000 brackets end in a
RecursionError, 60 MB of `[[],[],...` in 4 GB of memory, an integer of 5,000 digits in an error far from the file. Files
that people exchange (takes, streams, cameras, settings) are therefore parsed here; YAML, in `studio.yaml_text`, has the
same bounds.
"""

import errno
import json
import os
import re
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from v3studio.studio.errors import StudioError
from v3studio.studio.json_types import JsonObject

_BRACKETS = re.compile(rb"[\[{]+|[\]}]+")


@dataclass(frozen=True)
class Bounds:
    """The most that a text may hold: bytes, lists and objects inside of each other, and values of any kind, those of a
    YAML alias counted each time that it stands for them."""

    size: int = 64 << 20
    depth: int = 64
    values: int = 4_000_000
    digits: int = 40


BOUNDS = Bounds()


class TextError(ValueError):
    """A text that cannot be parsed, or is out of bounds. `str(error)` is a clause of bounded length; line and column
    are counted from 1, None if unknown."""

    def __init__(self, problem: str, line: int | None = None, column: int | None = None) -> None:
        super().__init__(problem)
        self.line, self.column = line, column


def parse_json(text: str | bytes, bounds: Bounds = BOUNDS, *, unique: bool = False) -> Any:
    """The value of a JSON text, bytes in UTF-8, -16 or -32 (RFC 8259; NaN and Infinity are accepted, as by Python's
    json). `unique`: no key twice in an object; else the last value counts. TextError: not JSON, or out of bounds."""
    check_text(text, bounds)
    try:
        value = json.loads(text, object_pairs_hook=_unique_keys if unique else None)
    except json.JSONDecodeError as error:
        raise TextError(error.msg, error.lineno, error.colno) from None
    except UnicodeDecodeError as error:
        raise TextError(f"not {error.encoding.upper()} text (byte {error.start})") from None
    except RecursionError:
        raise too_deep(bounds) from None
    except TextError:
        raise
    except ValueError:  # an integer of more than 4,300 digits
        raise _too_long(bounds) from None
    check_value(value, bounds)
    return value


def _unique_keys(pairs: list[tuple[str, Any]]) -> JsonObject:
    mapping = dict(pairs)
    if len(mapping) < len(pairs):
        keys = [key for key, _ in pairs]
        raise TextError(f"the key '{next(key for key in mapping if keys.count(key) > 1)}' appears twice")
    return mapping


def parse_toml(text: str, bounds: Bounds = BOUNDS) -> JsonObject:
    """The values of a TOML text (TOML 1.0). Raises TextError: not TOML, or out of bounds."""
    check_text(text, bounds)
    try:
        values = tomllib.loads(text)
    except RecursionError:
        raise too_deep(bounds) from None
    except ValueError as error:  # TOMLDecodeError, or an integer of more than 4,300 digits
        raise TextError(str(error)[:200]) from None
    check_value(values, bounds)
    return values


def check_text(text: str | bytes, bounds: Bounds = BOUNDS) -> None:
    """Refuse a text that would take too much time or memory to parse. Raises TextError: out of bounds."""
    data = text.encode("utf-8", "surrogatepass") if isinstance(text, str) else text
    if len(data) > bounds.size:
        raise TextError(f"it has {len(data):,} bytes; at most {bounds.size:,} are read")
    # every value but the first follows a comma or an opening bracket
    if data.count(b",") + data.count(b"[") + data.count(b"{") > bounds.values:
        raise TextError(f"it has more than {bounds.values:,} values")


def check_depth(text: str, bounds: Bounds = BOUNDS) -> None:
    """TextError if brackets are nested too deeply, those in quotes included: for parsers that take long over them."""
    depth = 0
    for match in _BRACKETS.finditer(text.encode("utf-8", "surrogatepass")):
        run = match[0]
        depth = depth + len(run) if run[:1] in b"[{" else max(0, depth - len(run))
        if depth > 2 * bounds.depth:  # brackets in quotes and comments do not have to match
            raise too_deep(bounds)


def check_value(value: Any, bounds: Bounds = BOUNDS) -> None:
    """TextError if a parsed value is nested too deeply or holds too many values or too long an integer."""
    largest = 10**bounds.digits
    known: dict[int, tuple[int, int]] = {}  # values and levels by id: what an alias stands for is walked once

    def measure(item: Any, depth: int) -> tuple[int, int]:
        if id(item) not in known:
            if depth > bounds.depth:  # also ends a value that contains itself
                raise too_deep(bounds)
            values = levels = 0
            for child in item.values() if isinstance(item, dict) else item:
                if isinstance(child, (dict, list)):
                    more, deep = measure(child, depth + 1)
                    values, levels = values + more, max(levels, deep)
                else:
                    values += 1
                    if type(child) is int and not -largest < child < largest:
                        raise _too_long(bounds)
            if values > bounds.values:
                raise TextError(f"it has more than {bounds.values:,} values")
            if levels > bounds.depth:
                raise too_deep(bounds)
            known[id(item)] = values + 1, levels + 1
        return known[id(item)]

    measure([value], 0)


def too_deep(bounds: Bounds) -> TextError:
    """The error for a text with too many values inside of each other."""
    return TextError(f"nested more than {bounds.depth} levels deep")


def _too_long(bounds: Bounds) -> TextError:
    return TextError(f"it has an integer of more than {bounds.digits} digits")


_PART = 1 << 20


def read_bounded(path: Path, limit: int = BOUNDS.size) -> bytes:
    """The whole file, if it has at most `limit` bytes; OSError if it cannot be read, is larger, or does not fit into
    memory; its `strerror` is a clause that says so."""
    parts, left = [], limit + 1
    try:
        with path.open("rb") as file:
            size = os.fstat(file.fileno()).st_size
            if size > limit:
                left = 0
            # a file is read at once, since parts are copied; a pipe, which has no size, in parts
            while left > 0 and (part := file.read(min(left, max(size + 1, _PART)))):
                parts.append(part)
                left -= len(part)
        data = b"".join(parts)
    except MemoryError:
        raise OSError(errno.ENOMEM, "it does not fit into memory", str(path)) from None
    if left <= 0:
        raise OSError(errno.EFBIG, f"it has more than the {limit:,} bytes that are read", str(path))
    return data


def read_bounded_text(path: Path) -> str:
    """A UTF-8 text of at most `BOUNDS.size` bytes, with every line ending as a newline; OSError as `read_bounded`,
    UnicodeDecodeError for another encoding."""
    return read_bounded(path).decode().replace("\r\n", "\n").replace("\r", "\n")


def need_utf8(path: Path) -> None:
    """Check that a path can be passed to every library and written to a settings file."""
    try:
        str(path).encode("utf-8")
    except UnicodeEncodeError:
        shown = str(path).encode("utf-8", "backslashreplace").decode()
        problem = "the path is not valid UTF-8"
        raise StudioError("path.not_utf8", problem, file=shown, fix="Rename the folder.") from None
