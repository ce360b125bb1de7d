"""Files of tie points: places that somebody marked in several cameras' pictures.

YAML (JSON is YAML too):

    points:
      corner of the mat:
        world: [0.0, 0.3, 0.0]       # optional, meters
        frame: 0                     # optional: the moment it was marked at
        pixels:
          cam01: [512.5, 830.0]      # column, row; the corner of the image is 0, 0
          cam02: [331.0, 702.5]
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from studio.camera_files.common import naming, write_atomic
from studio.errors import StudioError


class _Loader(yaml.BaseLoader):
    """YAML in which nothing is named twice."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        names = [key.value for key, _ in node.value]
        for name in names:
            if names.count(name) > 1:
                raise StudioError(
                    f"line {node.start_mark.line + 1} and below: two points are called '{name}', or two cameras of one."
                )
        return super().construct_mapping(node, deep)


@dataclass(frozen=True)
class TiePoint:
    """One place in the world, as cameras see it.

    Attributes:
        name: unique.
        pixels: camera name to (column, row) in pixels of the image as filmed, origin at the image's corner.
        world: (3,) where it lies in meters, z up; None where nobody measured it.
        frame: number of the frame that it was marked in, None for what stands still.
    """

    name: str
    pixels: dict[str, tuple[float, float]] = field(default_factory=dict)
    world: tuple[float, float, float] | None = None
    frame: int | None = None


def read_tie_points(path: Path) -> tuple[TiePoint, ...]:
    """Read a file of tie points.

    Raises:
        StudioError: the file is missing, is no YAML, or a value is not what it should be (named).
    """
    try:
        text = path.read_bytes().decode("utf-8-sig")
    except OSError as error:
        raise StudioError(f"{path}: cannot be read ({error.strerror}).") from None
    except UnicodeDecodeError:
        text = "["  # no text, so no YAML
    try:
        # everything as text, or camera 01 would become 1
        with naming(path):
            content = yaml.load(text, _Loader)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        place = f", line {mark.line + 1}" if mark is not None else ""
        raise StudioError(f"{path}{place}: this is no YAML; see 'Points by hand' in docs/CALIBRATION.md.") from None
    points = content.get("points") if isinstance(content, dict) else None
    if not isinstance(points, dict):
        raise StudioError(f"{path}: a file of tie points begins with 'points:', and under it a name for each point.")
    return tuple(_point(path, name, values) for name, values in points.items())


def write_tie_points(points: Sequence[TiePoint], path: Path) -> None:
    """Write them; `read_tie_points` gives the same back (pixels to a hundredth)."""
    content = {}
    for point in points:
        values: dict[str, Any] = {}
        if point.world is not None:
            values["world"] = [float(value) for value in point.world]
        if point.frame is not None:
            values["frame"] = point.frame
        values["pixels"] = {name: [round(float(x), 2), round(float(y), 2)] for name, (x, y) in point.pixels.items()}
        content[point.name] = values
    text = yaml.safe_dump({"points": content}, sort_keys=False, allow_unicode=True, default_flow_style=None)
    write_atomic(path, text.encode())


def _point(path: Path, name: str, values: Any) -> TiePoint:
    where = f"{path}: point '{name}'"
    if not isinstance(values, dict) or not isinstance(values.get("pixels"), dict):
        raise StudioError(f"{where} lacks 'pixels:', and under it a line 'camera: [column, row]' for each camera.")
    unknown = sorted(set(values) - {"pixels", "world", "frame"})
    if unknown:
        raise StudioError(f"{where} has '{unknown[0]}', which means nothing here; it takes pixels, world and frame.")
    pixels = {camera: _numbers(f"{where}, {camera}", xy, 2) for camera, xy in values["pixels"].items()}
    world, frame = values.get("world"), values.get("frame")
    if frame is not None and not str(frame).isdigit():
        raise StudioError(f"{where}: frame is {frame}; it must be a frame's number.")
    return TiePoint(
        name,
        {camera: (xy[0], xy[1]) for camera, xy in pixels.items()},
        None if world in (None, "null", "") else _numbers(f"{where}, world", world, 3),  # type: ignore[arg-type]
        None if frame is None else int(frame),
    )


def _numbers(where: str, value: Any, count: int) -> tuple[float, ...]:
    try:
        found = tuple(float(each) for each in value) if isinstance(value, list) else ()
    except (TypeError, ValueError):
        found = ()
    if len(found) != count or not all(map(math.isfinite, found)):
        example = ", ".join(["0.5"] * count)
        shown = f"[{', '.join(map(str, value))}]" if isinstance(value, list) else value
        raise StudioError(f"{where} is {shown}; it must be {count} numbers, as in [{example}].")
    return found
