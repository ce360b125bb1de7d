"""Counts and lists in sentences, and results that print as counts instead of values."""

from collections.abc import Collection
from dataclasses import fields
from typing import Any

_MAX_ITEMS, _MAX_TEXT = 4, 80  # of a field in `short_repr`


def counted(count: float, noun: str) -> str:
    """A count with its noun: "1 frame", "1,200 frames"."""
    return f"{count:,} {plural(noun, count)}"


def plural(noun: str, count: float) -> str:
    """The noun alone, as its count wants it: "frame" for 1, else "frames"."""
    return noun if count == 1 else f"{noun}s"


def span(values: Collection[float]) -> str:
    """Numbers as "294", or "294 to 310" if they differ."""
    ends = sorted({min(values), max(values)})
    return " to ".join(f"{end:,}" if isinstance(end, int) else f"{end:g}" for end in ends)


def size_words(count: float) -> str:
    """Bytes as "2.6 KB", "12.8 MB" or "1.4 GB" (1 KB = 1000 bytes)."""
    for unit, name in ((1e9, "GB"), (1e6, "MB")):
        if count >= unit:
            return f"{count / unit:.1f} {name}"
    return f"{count / 1000:.1f} KB"


def listed(words: Collection[str], most: int = 6) -> str:
    """Words in a sentence: "a", "a and b", or "a, b and 4 more" after the first `most`."""
    shown, more = list(words)[:most], len(words) - most
    parts = [*shown, f"{more} more"] if more > 0 else shown
    return "".join(parts) if len(parts) < 2 else f"{', '.join(parts[:-1])} and {parts[-1]}"


def cameras_listed(names: Collection[str], noun: str = "camera") -> str:
    """Cameras in a sentence: "camera 'a'", "cameras 'a' and 'b'"."""
    quoted = [f"'{name}'" for name in names]
    return f"{plural(noun, len(names))} {listed(quoted)}"


def short_repr(value: Any) -> str:
    """One line for a dataclass or a pydantic model; assign it to `__repr__` in the class."""
    names = tuple(getattr(type(value), "model_fields", ())) or tuple(field.name for field in fields(value))
    shown = ", ".join(f"{name}={_short(getattr(value, name))}" for name in names)
    return f"{type(value).__name__}({shown})"


def _short(value: Any) -> str:
    if hasattr(value, "shape"):
        return f"{value.dtype}{list(value.shape)}".removeprefix("torch.")
    if isinstance(value, tuple | list | dict) and len(value) > _MAX_ITEMS:
        return f"<{len(value)} items>"
    text = repr(value).partition("\n")[0]
    return text if len(text) <= _MAX_TEXT else f"{text[: _MAX_TEXT - 3]}..."
