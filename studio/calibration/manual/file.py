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

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from v3studio.studio.bounded_files import TextError, read_bounded
from v3studio.studio.camera_files.common import write_atomic
from v3studio.studio.errors import StudioError, first_violation
from v3studio.studio.json_types import JsonObject
from v3studio.studio.yaml_text import dump_yaml, parse_yaml

_OR_NULL = BeforeValidator(lambda value: None if value in ("", "null") else value)


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


class _Point(BaseModel):
    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)

    pixels: dict[str, tuple[float, float]]
    world: Annotated[tuple[float, float, float] | None, _OR_NULL] = None
    frame: Annotated[int | None, Field(ge=0), _OR_NULL] = None


class _File(BaseModel):
    points: dict[str, _Point]


def read_tie_points(path: Path | str) -> tuple[TiePoint, ...]:
    """Read a tie point file; StudioError if it is unreadable (tie_points.unreadable), not YAML (tie_points.syntax), or
    a value is missing, unknown or invalid (tie_points.invalid)."""
    path, fix = Path(path), "docs/guides/calibrate-points.md describes the format."
    try:
        # everything as text, or camera 01 would become 1
        content = parse_yaml(read_bounded(path).decode("utf-8-sig"), plain=True)
        points = _File.model_validate(content).points
    except OSError as error:
        fix = "Check the path and permissions."
        raise StudioError("tie_points.unreadable", f"cannot be read ({error.strerror})", file=path, fix=fix) from None
    except UnicodeDecodeError:
        raise StudioError("tie_points.syntax", "is not text in UTF-8", file=path, fix=fix) from None
    except TextError as error:
        raise StudioError("tie_points.syntax", f"invalid YAML ({error})", file=path, fix=fix, line=error.line) from None
    except ValidationError as error:
        key, problem = first_violation(error)
        raise StudioError("tie_points.invalid", problem, file=path, fix=fix, key=key) from None
    return tuple(TiePoint(name, point.pixels, point.world, point.frame) for name, point in points.items())


def write_tie_points(points: Sequence[TiePoint], path: Path) -> None:
    """Write a tie point file atomically, pixels rounded to 0.01; StudioError (camera_file.unwritable) if that fails."""
    content = {}
    for point in points:
        entry: JsonObject = {}
        if point.world is not None:
            entry["world"] = [float(value) for value in point.world]
        if point.frame is not None:
            entry["frame"] = point.frame
        entry["pixels"] = {name: [round(float(x), 2), round(float(y), 2)] for name, (x, y) in point.pixels.items()}
        content[point.name] = entry
    write_atomic(path, dump_yaml({"points": content}, flow=None, width=80).encode())
