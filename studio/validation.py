"""Numbers out of files, checked: whatever is wrong with them is one sentence that names the value."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from studio.errors import StudioError

_MEND = "mend the calibration file"


def number(values: Mapping[str, Any], key: str, who: str, default: float | None = None) -> float:
    """A finite number of a mapping; text that says a number counts (CSV and XML have nothing else).

    Raises:
        StudioError: it is missing (and has no default), no number, or not finite.
    """
    value = values.get(key, default)
    if value is None:
        raise StudioError(f"{who}: the key '{key}' is missing.")
    try:
        result = float(value)
    except (TypeError, ValueError, OverflowError):
        raise StudioError(f"{who}: '{key}' is {_shown(value)}, which is not a number; {_MEND}.") from None
    if not np.isfinite(result):
        raise StudioError(f"{who}: '{key}' is {result}, which is not a finite number; {_MEND}.")
    return result


def whole(values: Mapping[str, Any], key: str, who: str) -> int:
    """A whole number of a mapping; 640.0 is one.

    Raises:
        StudioError: as of `number`, or there is a fraction.
    """
    result = number(values, key, who)
    if result != round(result):
        raise StudioError(f"{who}: '{key}' is {result:g}, which is not a whole number; {_MEND}.")
    return int(result)


def array(value: Any, what: str, who: str) -> np.ndarray:
    """Nested lists of numbers (or of text that says numbers) as float64, of whatever shape. May hold NaN.

    Raises:
        StudioError: an entry is no number, or the rows are not of one length.
    """
    try:
        return np.array(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        place, wrong = _first_that_is_none(value)
        if not place and isinstance(value, list):
            raise StudioError(f"{who}: the rows of '{what}' are not of one length; {_MEND}.") from None
        raise StudioError(f"{who}: {what}{place} is {_shown(wrong)}, which is not a number; {_MEND}.") from None


def check_finite(value: np.ndarray, what: str, who: str) -> None:
    """Refuse an array with NaN or infinity, naming the first such entry.

    Raises:
        StudioError: as said.
    """
    broken = np.argwhere(~np.isfinite(value))
    if len(broken):
        place = "".join(f"[{index}]" for index in broken[0]) if value.size > 1 else ""
        raise StudioError(
            f"{who}: {what}{place} is {value[tuple(broken[0])]}, which is not a finite number; mend the calibration "
            "file."
        )


def _first_that_is_none(value: Any) -> tuple[str, Any]:
    """Place and value of the first entry that is no number; ("", value) where all are."""
    if not isinstance(value, list):
        return "", value
    for index, entry in enumerate(value):
        if isinstance(entry, list):
            place, wrong = _first_that_is_none(entry)
            if place:
                return f"[{index}]{place}", wrong
            continue
        try:
            float(entry)
        except (TypeError, ValueError, OverflowError):
            return f"[{index}]", entry
    return "", value


def _shown(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 40 else text[:37] + "..."
