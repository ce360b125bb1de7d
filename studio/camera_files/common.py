"""What the readers of camera files share: errors that name the file, and camera names from image paths."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from studio.errors import StudioError
from studio.validation import array, check_finite


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Puts the file's name before the message of any StudioError raised inside."""
    try:
        yield
    except StudioError as error:
        text = str(error)
        raise StudioError(text if text.startswith(str(path)) else f"{path}: {text}") from None


def read_text(path: Path) -> str:
    """The file's text (UTF-8).

    Raises:
        StudioError: it cannot be read, is empty, or is no text.
    """
    try:
        text = path.read_bytes().decode("utf-8-sig")
    except OSError as error:
        raise StudioError(f"{path}: cannot be read ({error.strerror}).") from None
    except UnicodeDecodeError:
        raise StudioError(f"{path}: is not a text file; give a camera file in one of the known formats.") from None
    if not text.strip():
        raise StudioError(f"{path}: the file is empty; export the cameras again.")
    return text


def read_json(path: Path) -> dict[str, Any]:
    """A JSON object.

    Raises:
        StudioError: the file is no whole JSON object; says where it breaks off.
    """
    try:
        value = json.loads(read_text(path))
    except json.JSONDecodeError as error:
        raise StudioError(
            f"{path}: not valid JSON at line {error.lineno}, column {error.colno} ({error.msg}); "
            "the file may be cut short, export the cameras again."
        ) from None
    if not isinstance(value, dict):
        raise StudioError(f"{path}: holds a JSON {type(value).__name__}, but a camera file is a JSON object.")
    return value


def write_atomic(path: Path, data: bytes) -> None:
    """Write under a temporary name in the same folder, then rename."""
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        temporary.write_bytes(data)
        os.replace(temporary, path)
    except OSError as error:
        raise StudioError(f"{path}: cannot be written ({error.strerror}).") from None
    finally:
        temporary.unlink(missing_ok=True)


def read_csv(path: Path, columns: Sequence[str]) -> list[dict[str, str]]:
    """The rows of a CSV file with a heading (which may begin with #), as column to text.

    Raises:
        StudioError: a column is missing, a row is too short, no row is there.
    """
    lines = [line for line in read_text(path).splitlines() if line.strip()]
    heads = [head.strip().lstrip("#").strip() for head in lines[0].split(",")]
    missing = [column for column in columns if column not in heads]
    if missing:
        raise StudioError(f"{path}: the column '{missing[0]}' is missing (there is {', '.join(heads)}).")
    rows = []
    for count, line in enumerate(lines[1:], 1):
        cells = [cell.strip() for cell in line.split(",")]
        if line.startswith("#"):
            continue
        if len(cells) < len(heads):
            raise StudioError(
                f"{path}: row {count} ('{cells[0]}') has {len(cells)} values where {len(heads)} are needed; is it cut "
                "short?"
            )
        row = dict(zip(heads, cells, strict=False))
        if not row[columns[0]]:
            raise StudioError(f"{path}: row {count} has no '{columns[0]}'.")
        rows.append(row)
    if not rows:
        raise StudioError(f"{path}: holds no camera; export the cameras again.")
    return rows


def matrix(value: Any, rows: tuple[int, ...], columns: int, what: str, who: str) -> np.ndarray:
    """A matrix of numbers with one of the given row counts.

    Raises:
        StudioError: the wrong shape, something that is not a number, or not finite.
    """
    result = array(value, what, who)
    if result.ndim != 2 or result.shape[0] not in rows or result.shape[1] != columns:
        wanted = " or ".join(f"{n}x{columns}" for n in rows)
        raise StudioError(f"{who}: {what} has shape {result.shape}; {wanted} is needed.")
    check_finite(result, what, who)
    return result


def camera_names(paths: Sequence[str]) -> list[str]:
    """Short camera names from image paths: file names without extension where these differ, else folders.

    `images/cam00.png` gives `cam00`; `cam00/000000.png`, `cam01/000000.png` give `cam00`, `cam01`; where neither
    tells the cameras apart the path without extension is kept (two equal paths stay equal, for `Rig` to refuse).
    """
    parts = [PurePosixPath(path.replace("\\", "/")) for path in paths]
    whole = [str(part.with_suffix("")) if part.name else str(part) for part in parts]
    stems = [part.stem for part in parts]
    if len(set(stems)) == len(stems):
        return stems
    folders = [part.parent.name for part in parts]
    if len(set(folders)) == len(folders) and all(folders):
        return folders
    return stems if len(set(whole)) == len(set(stems)) else whole


def rigid_inverse(pose: np.ndarray) -> np.ndarray:
    """Inverse (4, 4) of a rigid transform given as (3, 4) or (4, 4)."""
    result = np.eye(4)
    result[:3, :3] = pose[:3, :3].T
    result[:3, 3] = -pose[:3, :3].T @ pose[:3, 3]
    return result
