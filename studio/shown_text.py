"""Text from files and file names as it may be shown: control characters could steer a terminal, and bidirectional ones
make a name look like another one."""

import re

_BIDI = "\u061c\u200e\u200f\u202a-\u202e\u2066-\u2069"
_HIDDEN = re.compile(f"[\x00-\x1f\x7f-\x9f{_BIDI}]")
_HIDDEN_IN_LINES = re.compile(f"[\x00-\x08\x0b-\x1f\x7f-\x9f{_BIDI}]")


def plain_text(text: str) -> str:
    """Return one line of text without such characters; white space becomes single spaces. Joiners, which emoji and some
    scripts need, stay."""
    return " ".join(_HIDDEN.sub("", " ".join(text.split())).split())


def visible(text: str) -> str:
    """Return text with a "?" for each such character; line breaks and tabs stay."""
    return _HIDDEN_IN_LINES.sub("?", text)
