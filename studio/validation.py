"""Validated numbers from camera files: errors name the camera, the key and the value."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from v3studio.studio.errors import StudioError


def camera_error(
    code: str, camera: str, problem: str, *, fix: str = "Export the cameras again.", **more: Any
) -> StudioError:
    """The error for a camera; `more` as for `StudioError`."""
    return StudioError(code, f"Camera '{camera}': {problem}", fix=fix, camera=camera, **more)


def number(values: Mapping[str, Any], key: str, camera: str, default: float | None = None) -> float:
    """A finite number from a mapping, or as text, because CSV and XML files only contain text; a missing key without
    default is an error. StudioError: camera.missing_key, camera.not_a_number, or camera.not_finite."""
    value = values.get(key, default)
    if value is None:
        raise missing_key(key, camera)
    try:
        if isinstance(value, bool):
            raise TypeError
        result = float(value)
    except (TypeError, ValueError, OverflowError):
        raise _not_a_number(f"'{key}'", value, camera, key) from None
    if not np.isfinite(result):
        raise _not_a_number(f"'{key}'", result, camera, key, code="camera.not_finite")
    return result


def whole(values: Mapping[str, Any], key: str, camera: str) -> int:
    """An integer from a mapping; 640.0 is accepted."""
    result = number(values, key, camera)
    if result != round(result):
        problem = f"'{key}' is {result:g}, not an integer"
        fix = "Correct it in the camera file."
        raise camera_error("camera.not_an_integer", camera, problem, value=result, fix=fix, key=key)
    return int(result)


def array(value: Any, key: str, camera: str) -> np.ndarray:
    """Nested lists of numbers, or of numbers as text, as a float64 array of any shape, which may contain NaN.
    StudioError if an entry is not a number (camera.not_a_number), or rows differ in length (camera.ragged)."""
    try:
        return np.array(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        index, wrong = _first_non_number(value)
        if not index and isinstance(value, list):
            problem = f"the rows of '{key}' differ in length"
            fix = "Correct the matrix in the camera file."
            raise camera_error("camera.ragged", camera, problem, fix=fix, key=key) from None
        raise _not_a_number(f"{key}{index}", wrong, camera, key, index) from None


def check_finite(value: np.ndarray, key: str, camera: str) -> None:
    """StudioError (camera.not_finite) that names the first entry that is NaN or infinite."""
    broken = np.argwhere(~np.isfinite(value))
    if len(broken):
        index = "".join(f"[{i}]" for i in broken[0]) if value.size > 1 else ""
        raise _not_a_number(
            f"{key}{index}", float(value[tuple(broken[0])]), camera, key, index, code="camera.not_finite"
        )


def missing_key(key: str, camera: str) -> StudioError:
    """The error for a required key that is missing for a camera (camera.missing_key)."""
    return camera_error("camera.missing_key", camera, f"the key '{key}' is missing", key=key)


def _not_a_number(
    what: str, value: Any, camera: str, key: str, index: str = "", code: str = "camera.not_a_number"
) -> StudioError:
    problem = f"{what} is {_shown(value)}, not a {'finite ' if code == 'camera.not_finite' else ''}number"
    return camera_error(code, camera, problem, value=value, fix="Correct it in the camera file.", key=key, index=index)


def _first_non_number(value: Any) -> tuple[str, Any]:
    """Index and value of the first entry that is not a number; ("", value) if there is none."""
    if not isinstance(value, list):
        return "", value
    for index, entry in enumerate(value):
        if isinstance(entry, list):
            inner, wrong = _first_non_number(entry)
            if inner:
                return f"[{index}]{inner}", wrong
            continue
        try:
            float(entry)
        except (TypeError, ValueError, OverflowError):
            return f"[{index}]", entry
    return "", value


def _shown(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 40 else text[:37] + "..."
