"""Tie point files: points marked by hand in the images of several cameras.

YAML (of which JSON is a subset):

    points:
      corner of the mat:
        world: [0.0, 0.3, 0.0]       # optional, meters
        frame: 0                     # optional: the frame in which it was marked
        pixels:
          cam01: [512.5, 830.0]      # column, row; the upper left corner of the image is 0, 0
          cam02: [331.0, 702.5]
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from studio.bounded_files import read_bounded
from studio.camera_files.common import write_atomic
from studio.errors import StudioError, naming
from studio.json_types import JsonObject
from studio.yaml_text import DuplicateKey, YamlError, dump_yaml, parse_yaml


@dataclass(frozen=True)
class TiePoint:
    """A point in the world and its marks in the images.

    Attributes:
        pixels: camera name to (column, row) in pixels of the raw (distorted) image, origin at its upper left corner.
        world: (3,) measured position in meters, z up; None if not measured.
        frame: frame in which it was marked; None if it does not move.
    """

    name: str
    pixels: dict[str, tuple[float, float]] = field(default_factory=dict)
    world: tuple[float, float, float] | None = None
    frame: int | None = None


def read_tie_points(path: Path | str) -> tuple[TiePoint, ...]:
    """Read a tie point file; StudioError if it is unreadable (tie_points.unreadable), not YAML (tie_points.syntax), or
    a value is invalid (tie_points.*)."""
    path = Path(path)
    try:
        text = read_bounded(path).decode("utf-8-sig")
    except OSError as error:
        fix = "Check the path and permissions."
        raise StudioError("tie_points.unreadable", f"cannot be read ({error.strerror})", file=path, fix=fix) from None
    except UnicodeDecodeError:
        text = "["  # not text, so not YAML
    try:
        # everything as text, or camera 01 would become 1
        content = parse_yaml(text, plain=True)
    except DuplicateKey as error:
        problem = f"line {error.mapping_line} and below: '{error.key}' is used twice"
        fix = "Use a unique name for each point, and list each camera of a point only once."
        raise StudioError(
            "tie_points.duplicate", problem, file=path, value=error.key, fix=fix, line=error.mapping_line
        ) from None
    except YamlError as error:
        problem = "invalid YAML" + (f" at line {error.line}" if error.line else "")
        fix = "docs/guides/calibrate-points.md describes the format."
        raise StudioError("tie_points.syntax", problem, file=path, fix=fix, line=error.line) from None
    points = content.get("points") if isinstance(content, dict) else None
    if not isinstance(points, dict):
        fix = "Add 'points:' with one entry per point."
        raise StudioError("tie_points.no_points", "the key 'points' is missing", file=path, fix=fix, key="points")
    with naming(path):
        return tuple(_point(name, values) for name, values in points.items())


def write_tie_points(points: Sequence[TiePoint], path: Path) -> None:
    """Write a tie point file atomically, pixels rounded to 0.01; StudioError (camera_file.unwritable) if that fails."""
    content = {}
    for point in points:
        values: JsonObject = {}
        if point.world is not None:
            values["world"] = [float(value) for value in point.world]
        if point.frame is not None:
            values["frame"] = point.frame
        values["pixels"] = {name: [round(float(x), 2), round(float(y), 2)] for name, (x, y) in point.pixels.items()}
        content[point.name] = values
    write_atomic(path, dump_yaml({"points": content}, flow=None, width=80).encode())


def _point(name: str, values: Any) -> TiePoint:
    if not isinstance(values, dict) or not isinstance(values.get("pixels"), dict):
        fix = "Add 'pixels:' with one line 'camera: [column, row]' per camera."
        raise StudioError("tie_points.no_pixels", f"point '{name}' has no 'pixels'", fix=fix, point=name, key="pixels")
    unknown = sorted(set(values) - {"pixels", "world", "frame"})
    if unknown:
        problem = f"point '{name}' has an unknown key '{unknown[0]}'"
        fix = "The keys of a point are pixels, world and frame."
        raise StudioError("tie_points.unknown_key", problem, value=unknown[0], fix=fix, point=name, key=unknown[0])
    pixels = {camera: _numbers(name, camera, xy, 2) for camera, xy in values["pixels"].items()}
    world, frame = values.get("world"), values.get("frame")
    if frame is not None and not str(frame).isdigit():
        problem = f"point '{name}': frame is {frame}, not a frame number"
        fix = "Specify an integer; example: 24."
        raise StudioError("tie_points.frame", problem, value=frame, fix=fix, point=name, key="frame")
    return TiePoint(
        name,
        {camera: (xy[0], xy[1]) for camera, xy in pixels.items()},
        None if world in (None, "null", "") else _numbers(name, "world", world, 3),  # type: ignore[arg-type]
        None if frame is None else int(frame),
    )


def _numbers(point: str, key: str, value: Any, count: int) -> tuple[float, ...]:
    try:
        found = tuple(float(each) for each in value) if isinstance(value, list) else ()
    except (TypeError, ValueError):
        found = ()
    if len(found) != count or not all(map(math.isfinite, found)):
        example = ", ".join(["0.5"] * count)
        shown = f"[{', '.join(map(str, value))}]" if isinstance(value, list) else value
        problem = f"point '{point}': {key} is {shown}, expected {count} numbers"
        fix = f"Example: [{example}]."
        raise StudioError("tie_points.not_numbers", problem, value=value, fix=fix, point=point, key=key, expected=count)
    return found
