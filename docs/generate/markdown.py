"""Plain text as Markdown."""

import re

_SPECIAL = re.compile(r"([\\*_\[\]{}<>|#])")
_SPAN = re.compile(r"``?([^`]+)``?")


def escaped(text: str) -> str:
    """`text` on one line with Markdown's special characters escaped; `code spans` stay code. Outer spaces stay."""
    parts, end = [], 0
    text = re.sub(r"\s+", " ", text)
    for span in _SPAN.finditer(text):
        parts += [_SPECIAL.sub(r"\\\1", text[end : span.start()]), code(span[1])]
        end = span.end()
    return "".join([*parts, _SPECIAL.sub(r"\\\1", text[end:])])


def code(text: str) -> str:
    """A code span that survives a table cell."""
    text = text.replace("|", "&#124;")
    return f"<code>{text}</code>" if "&#124;" in text else f"`{text}`"


def table(*rows: tuple[str, ...]) -> list[str]:
    """A Markdown table; the first row is its head. Cells are Markdown already."""
    head, *body = rows
    lines = [" | ".join(head), " | ".join("---" for _ in head), *(" | ".join(row) for row in body)]
    return [f"| {line} |" for line in lines]
