"""Ranges of frames as text, as commands and settings take them."""

import re

ALL_FRAMES = (None, None, 1)  # ":"


def parse_frame_range(text: str) -> tuple[int | None, int | None, int]:
    """First frame (or None), frame to stop before (or None) and step of "A:B:S" or parts. Raises ValueError."""
    match = re.fullmatch(r"(\d*):(\d*)(?::(\d+))?", text)
    start, stop, step = (int(part) if part else None for part in match.groups()) if match else (None, None, 0)
    if step == 0 or (stop is not None and stop <= (start or 0)):
        raise ValueError(f"'{text}' is not of the form A:B or A:B:S; example: 0:20 for frames 0 to 19")
    return start, stop, step or 1
