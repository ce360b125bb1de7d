"""Code shared by the camera file readers: reading, errors, camera names from image paths."""

import csv
import re
from collections.abc import Collection, Sequence
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from v3studio.studio.atomic_files import write_bytes
from v3studio.studio.bounded_files import TextError, parse_json, read_bounded
from v3studio.studio.cameras import Camera
from v3studio.studio.capture.patterns import without_extension
from v3studio.studio.errors import StudioError
from v3studio.studio.json_types import JsonObject
from v3studio.studio.validation import camera_error


def read_text(path: Path) -> str:
    """The text of a UTF-8 file; StudioError if it cannot be read (camera_file.unreadable), is not text
    (camera_file.not_text) or is empty (camera_file.empty)."""
    try:
        text = read_bounded(path).decode("utf-8-sig")
    except OSError as error:
        raise unreadable(path, error) from None
    except UnicodeDecodeError:
        data = path.read_bytes()[:4096]
        kind = next((kind for magic, kind in _BINARY if data.startswith(magic)), "")
        if kind or (b"\0" in data and data[:2] not in (b"\xff\xfe", b"\xfe\xff")):
            problem = f"{kind or 'a binary file of an unknown kind'}, which is not read"
            fix = "Export the cameras as text, such as transforms.json, intri.yml and extri.yml, or COLMAP's model."
            raise StudioError("camera_file.unsupported_kind", problem, file=path, value=kind, fix=fix) from None
        fix = "Save it as UTF-8."
        raise StudioError("camera_file.not_text", "not text in UTF-8", file=path, fix=fix) from None
    if not text.strip():
        raise StudioError("camera_file.empty", "the file is empty", file=path, fix="Export the cameras again.")
    return text


_BINARY = (
    (b"PK", "a zip archive, such as NumPy's .npz"),
    (b"\x80", "a Python pickle"),
    (b"MATLAB", "a MATLAB file"),
    (b"\x89HDF", "an HDF5 or MATLAB file"),
    (b"\x93NUMPY", "a NumPy array"),
    (b"Kaydara FBX", "an FBX scene"),
    (b"PXR-USD", "a USD scene"),
    (b"glTF", "a glTF scene"),
    (b"\x1f\x8b", "a gzip archive"),
    (b"SQLite", "a database, such as COLMAP's, which has no poses"),
)


def unreadable(path: Path, error: OSError) -> StudioError:
    """The error for a file that the operating system cannot read (camera_file.unreadable)."""
    problem = f"cannot be read ({error.strerror})"
    return StudioError("camera_file.unreadable", problem, file=path, fix="Check the path and permissions.")


def need_both(folder: Path, names: tuple[str, str], program: str) -> None:
    """Raise StudioError (camera_file.missing) unless both files of a program are in a folder."""
    for name in names:
        if not (folder / name).is_file():
            fix = f"{program} cameras need both {names[0]} and {names[1]} in one folder."
            raise StudioError("camera_file.missing", "camera file not found", file=folder / name, fix=fix)


def no_cameras(problem: str, file: Path | None = None) -> StudioError:
    """The error for a file without any camera (camera_file.no_cameras)."""
    return StudioError("camera_file.no_cameras", problem, file=file, fix="Export the cameras again.")


def read_json_value(path: Path) -> Any:
    """A JSON value of any kind."""
    try:
        return parse_json(read_text(path), unique=True)
    except TextError as error:
        where = f" at line {error.line}, column {error.column}" if error.line else ""
        problem = f"invalid JSON{where} ({error})"
        fix = "Correct it, or export the cameras again."
        raise StudioError(
            "camera_file.syntax", problem, file=path, fix=fix, line=error.line, column=error.column
        ) from None


def read_json(path: Path) -> JsonObject:
    """A JSON object."""
    value = read_json_value(path)
    if not isinstance(value, dict):
        problem = f"the file contains a JSON {type(value).__name__}, expected an object"
        raise StudioError("camera_file.not_an_object", problem, file=path, fix="Export the cameras again.")
    return value


def json_object(entry: Any) -> JsonObject:
    """An entry of a list of cameras. Raises StudioError (camera_file.not_an_object) if it is no object."""
    if not isinstance(entry, dict):
        problem = f"an entry of the list of cameras is {type(entry).__name__}, not an object"
        raise StudioError("camera_file.not_an_object", problem, value=entry, fix="Export the cameras again.")
    return entry


def write_atomic(path: Path, data: bytes) -> None:
    """Write a file atomically. Raises StudioError (camera_file.unwritable)."""
    try:
        write_bytes(path, data)
    except OSError as error:
        problem = f"cannot be written ({error.strerror})"
        fix = "Check the free space and permissions."
        raise StudioError("camera_file.unwritable", problem, file=path, fix=fix) from None


def read_csv(path: Path, columns: Sequence[str], optional: Collection[str] = ()) -> list[dict[str, str]]:
    """The rows of a CSV file, each as column to text, with the required `columns`, of which the first names the row.

    The header may start with #; other lines with # are comments. Cells are separated by commas, semicolons or tabs;
    without commas as separators, numbers may have decimal commas, which are replaced by periods.

    Raises:
        StudioError: a column is missing (camera_file.missing_column) or unknown and not 0 (camera_file.unknown_column),
            a row has another number of cells (camera_file.truncated) or has an empty first column
            (camera_file.empty_cell), or there are no rows (camera_file.no_cameras).
    """
    lines = [line for line in read_text(path).splitlines() if line.strip()]
    separator = max(",;\t", key=lambda mark: max(len(set(columns) & set(_heads(line, mark))) for line in lines[:20]))
    first = max(range(min(20, len(lines))), key=lambda index: len(set(columns) & set(_heads(lines[index], separator))))
    heads = _heads(lines[first], separator)
    missing = [column for column in columns if column not in heads]
    if missing:
        problem = f"the column '{missing[0]}' is missing; the columns are {', '.join(heads)}"
        fix = "Export the cameras again."
        raise StudioError("camera_file.missing_column", problem, value=heads, fix=fix, key=missing[0])
    rows = []
    body = [line for line in lines[first + 1 :] if not line.startswith("#")]
    for count, cells in enumerate(csv.reader(body, delimiter=separator, skipinitialspace=True), 1):
        cells = [cell.strip() for cell in cells]
        if len(cells) < len(heads) or any(cells[len(heads) :]):
            problem = f"row {count} ('{cells[0]}') has {len(cells)} values, expected {len(heads)}"
            fix = "The file may be truncated: export the cameras again."
            raise StudioError(
                "camera_file.truncated", problem, value=len(cells), fix=fix, row=count, expected=len(heads)
            )
        if separator != ",":
            cells = [_DECIMAL_COMMA.sub(r"\1.\2", cell) for cell in cells]
        row = dict(zip(heads, cells, strict=False))
        if not row[columns[0]]:
            problem = f"row {count} has no '{columns[0]}'"
            fix = "Export the cameras again."
            raise StudioError("camera_file.empty_cell", problem, fix=fix, row=count, key=columns[0])
        rows.append(row)
    if not rows:
        raise no_cameras("no cameras in the file")
    for head in heads:
        if head not in {*columns, *optional} and any(row[head].strip("+-0.") for row in rows):
            problem = f"the column '{head or '(without a name)'}' is not known and may change how the cameras project"
            fix = "Delete the column if it does not belong to the lens."
            raise StudioError("camera_file.unknown_column", problem, value=head, fix=fix, key=head)
    return rows


_DECIMAL_COMMA = re.compile(r"^([-+]?\d*),(\d+(?:[eE][-+]?\d+)?)$")


def _heads(line: str, separator: str) -> list[str]:
    return [head.strip().lstrip("#").strip() for head in line.split(separator)]


def check_pose(pose: np.ndarray, key: str, camera: str) -> None:
    """Check the last row of a pose (3, 4) or (4, 4), which is not that of a transposed matrix."""
    if len(pose) == 4 and np.abs(pose[3] - [0, 0, 0, 1]).max() > 1e-6:
        problem = f"the last row of '{key}' is {pose[3].tolist()}, expected 0 0 0 1"
        fix = "Transpose the matrix if its last column is 0 0 0 1, or export the cameras again."
        raise camera_error("camera.not_rigid", camera, problem, value=pose[3].tolist(), fix=fix, key=key)


def wrong_shape(key: str, camera: str, actual: tuple[int, ...], expected: tuple[tuple[int, ...], ...]) -> StudioError:
    """The error for an array of the wrong shape (camera.wrong_shape)."""
    wanted = " or ".join("x".join(map(str, shape)) for shape in expected)
    problem = f"'{key}' is {'x'.join(map(str, actual)) or 'a single value'}, expected {wanted}"
    return camera_error(
        "camera.wrong_shape", camera, problem, value=list(actual), key=key, expected=[list(shape) for shape in expected]
    )


def check_expressible(camera: Camera, form: str, terms: int, fisheye: bool = False) -> None:
    """StudioError (camera_file.not_expressible) if a camera has skew, distortion beyond the first `terms`, or a fisheye
    lens where `fisheye` is not set."""
    skew, count = float(camera.K[0, 1]), camera.distortion.size
    value: float | str
    if abs(skew) > 1e-9:
        value, problem, way = skew, f"{form} cannot express skew ({skew:g})", "Calibrate without skew"
    elif camera.fisheye and not fisheye:
        value, problem, way = "fisheye", f"{form} cannot express a fisheye lens", "Undistort the images first"
    elif np.any(camera.distortion[terms:]):
        value, way = count, "Undistort the images first"
        problem = f"{form} can express {terms or 'no'} terms of OpenCV's lens distortion, but this camera has {count}"
    else:
        return
    raise camera_error(
        "camera_file.not_expressible", camera.name, problem, value=value, fix=f"{way}, or write rig.json."
    )


def camera_names(paths: Sequence[str]) -> list[str]:
    """Short camera names from image paths: file names without extension if they are unique (`images/cam00.png`:
    `cam00`), else folder names (`cam00/000000.png`, `cam01/000000.png`: `cam00`, `cam01`), else the path without
    extension (equal paths stay equal, and `Rig` rejects them)."""
    parts = [PurePosixPath(without_extension(path)) for path in paths]
    whole = [str(part) for part in parts]
    stems = [part.name for part in parts]
    if len(set(stems)) == len(stems):
        return stems
    folders = [part.parent.name for part in parts]
    if len(set(folders)) == len(folders) and all(folders):
        return folders
    return stems if len(set(whole)) == len(set(stems)) else whole


def rigid_inverse(pose: np.ndarray) -> np.ndarray:
    """Inverse (4, 4) of a rigid transform (3, 4) or (4, 4)."""
    back = pose[:3, :3].T
    return np.vstack([np.column_stack([back, -back @ pose[:3, 3]]), [0, 0, 0, 1]])
