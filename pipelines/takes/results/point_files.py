"""Meshes and point clouds as binary PLY."""

import re
from pathlib import Path

import numpy as np

from v3studio.studio.bounded_files import read_bounded
from v3studio.studio.camera_files import read_rig
from v3studio.studio.errors import StudioError
from v3studio.studio.own_frame import own_frame


def write_mesh(path: Path, vertices: np.ndarray, faces: np.ndarray) -> None:
    """Write vertices (V, 3), stored as float32, and triangles (F, 3)."""
    rows = np.zeros(len(vertices), [(name, "<f4") for name in "xyz"])
    for column, name in enumerate("xyz"):
        rows[name] = vertices[:, column]
    triangles = np.zeros(len(faces), [("vertex_indices", "<i4", 3)])
    triangles["vertex_indices"] = faces
    _write(path, vertex=rows, face=triangles)


def _write(path: Path, **elements: np.ndarray) -> None:
    from plyfile import PlyData, PlyElement

    described = [PlyElement.describe(rows, name, {"vertex_indices": "u1"}) for name, rows in elements.items()]
    PlyData(described, byte_order="<").write(str(path))


_MAX_BYTES = 4 << 30
_POINT = np.dtype(
    [(name, "<f4") for name in ("x", "y", "z", "nx", "ny", "nz")] + [(name, "u1") for name in ("red", "green", "blue")]
)
_FAR_POINT = np.dtype([(name, "<f8" if name in "xyz" else _POINT[name]) for name in _POINT.names or ()])


def write_points(
    path: Path, points: np.ndarray, normals: np.ndarray | None, colors: np.ndarray, doubles: bool = False
) -> None:
    """Write positions (N, 3), normals (N, 3) (None: zeros) and colors (N, 3), 0 to 255; `doubles`: positions with 64
    bits, for points that may be far from zero."""
    rows = np.zeros(len(points), dtype=_FAR_POINT if doubles else _POINT)
    for column, name in enumerate(("x", "y", "z")):
        rows[name] = points[:, column]
        if normals is not None:
            rows["n" + name] = normals[:, column]
    for column, name in enumerate(("red", "green", "blue")):
        rows[name] = np.clip(colors[:, column], 0, 255)
    _write(path, vertex=rows)


def read_points(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Read positions (N, 3) as written and colors (N, 3) float32 in 0 to 1. Raises StudioError: `take.damaged`."""
    rows = _rows(path)
    return _columns(rows, "x", "y", "z"), _columns(rows, "red", "green", "blue").astype(np.float32) / 255


def read_sparse_points(path: Path, rig: Path) -> tuple[np.ndarray, np.ndarray]:
    """Read the points of a calibration, and their colors: float32, in the own frame of the take whose rig.json
    `rig` is."""
    points, colors = read_points(path)
    return own_frame(read_rig(rig)).points(points).astype(np.float32), colors


def read_surface(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Read what `write_points` wrote: positions and normals, (N, 3) float32. Raises StudioError: `take.damaged`."""
    rows = _rows(path)
    return _columns(rows, "x", "y", "z"), _columns(rows, "nx", "ny", "nz")


def _columns(rows: np.ndarray, *names: str) -> np.ndarray:
    return np.column_stack([rows[name] for name in names])


def _rows(path: Path) -> np.ndarray:
    fix = "Run `v3studio initialize --force`."
    try:
        header, _, body = read_bounded(path, _MAX_BYTES).partition(b"end_header\n")
    except OSError as error:
        problem = f"cannot be read ({error.strerror})"
        raise StudioError("take.damaged", problem, file=path, fix=fix, stage="initialize") from None
    element = re.search(rb"^element vertex ([0-9]{1,12})$", header, re.MULTILINE)
    count = int(element[1]) if element else -1
    kinds = _FAR_POINT if b"property double x" in header else _POINT
    if count < 0 or len(body) != count * kinds.itemsize:
        raise StudioError("take.damaged", "the file is damaged", file=path, fix=fix, stage="initialize")
    return np.frombuffer(body, dtype=kinds)
