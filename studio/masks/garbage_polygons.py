"""Garbage masks drawn as polygons, in one file for all cameras.

YAML (of which JSON is a subset), in pixels of the stored frames, with 0, 0 at the upper left corner of the image:

    cam01:
      remove: [[[0, 0], [1920, 0], [1920, 210], [0, 180]]]    # the performer is never in here
    cam02:
      keep: [[[300, 40], [1500, 40], [1500, 1060], [300, 1060]]]    # and never outside of these
      size: [1920, 1080]                                      # optional: size of the image that they were drawn on
"""

import math
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from studio.atomic_files import write_text
from studio.bounded_files import read_bounded
from studio.errors import StudioError
from studio.yaml_text import DuplicateKey, YamlError, dump_yaml, parse_yaml

EXTENSIONS = (".yaml", ".yml", ".json")  # of files with polygons; garbage masks with other extensions are images
_BITS = 4  # of a pixel's fraction, for OpenCV


@dataclass(frozen=True)
class GarbagePolygons:
    """The polygons of one camera, (N, 2) float64 corners each, in pixels."""

    keep: tuple[np.ndarray, ...] = ()  # the performer is inside one of them; empty: no limit
    remove: tuple[np.ndarray, ...] = ()  # the performer is in none of them
    size: tuple[float, float] | None = None  # (width, height) of the image that they refer to; None: the stored frames

    def inside(self, width: int, height: int) -> np.ndarray:
        """(H, W) bool, where the performer may be in an image of this size in pixels."""
        import cv2

        scale = np.array([width / self.size[0], height / self.size[1]]) if self.size is not None else np.ones(2)
        mask = np.zeros((height, width), np.uint8) if self.keep else np.full((height, width), 255, np.uint8)
        for polygons, value in ((self.keep, 255), (self.remove, 0)):
            for polygon in polygons:  # OpenCV counts from the center of the first pixel
                corners = np.rint((polygon * scale - 0.5) * (1 << _BITS)).astype(np.int32)
                cv2.fillPoly(mask, [corners], value, shift=_BITS)
        return mask > 0


def read_garbage_polygons(path: Path) -> dict[str, GarbagePolygons]:
    """The polygons of a file, by camera. Raises StudioError: `mask.garbage_file`."""
    try:
        content = parse_yaml(read_bounded(path).decode("utf-8-sig"), plain=True)  # or camera 01 would become 1
    except OSError as error:
        _refuse(path, f"cannot be read ({error.strerror})")
    except UnicodeDecodeError:
        _refuse(path, "is not text")
    except DuplicateKey as error:
        _refuse(path, f"'{error.key}' is used twice, at line {error.line}", error.key)
    except YamlError as error:
        _refuse(path, "is not valid YAML" + (f" (line {error.line})" if error.line else ""))
    if not isinstance(content, Mapping) or not content:
        _refuse(path, "has no cameras")
    return {str(camera): _camera(path, str(camera), value) for camera, value in content.items()}


def write_garbage_polygons(path: Path, polygons: Mapping[str, GarbagePolygons]) -> None:
    """Write what `read_garbage_polygons` reads; cameras without polygons are left out. Raises OSError."""
    tree = {}
    for camera, one in polygons.items():
        lists = {"keep": one.keep, "remove": one.remove}
        found: dict[str, Any] = {
            key: [np.round(polygon, 2).tolist() for polygon in value] for key, value in lists.items() if value
        }
        if found:
            tree[camera] = found | ({"size": list(one.size)} if one.size is not None else {})
    write_text(path, dump_yaml(tree, flow=None))


def _camera(path: Path, camera: str, value: Any) -> GarbagePolygons:
    known = ("keep", "remove", "size")
    if not isinstance(value, Mapping) or not value:
        _refuse(path, f"camera '{camera}' has no polygons", camera)
    for key in value:
        if key not in known:
            _refuse(path, f"camera '{camera}': '{key}' is not one of {', '.join(known)}", str(key))
    size = None
    if "size" in value:
        width, height = _pair(path, camera, value["size"])
        if min(width, height) < 1:
            _refuse(path, f"camera '{camera}': the size must be positive", (width, height))
        size = (width, height)
    if "keep" not in value and "remove" not in value:
        _refuse(path, f"camera '{camera}' has a size but no polygons", camera)
    found = {key: _polygons(path, camera, value[key]) if key in value else () for key in ("keep", "remove")}
    return GarbagePolygons(found["keep"], found["remove"], size)


def _polygons(path: Path, camera: str, value: Any) -> tuple[np.ndarray, ...]:
    if not isinstance(value, list) or not value:
        _refuse(path, f"camera '{camera}': expected a list of polygons", camera)
    for polygon in value:
        if not isinstance(polygon, list) or len(polygon) < 3:
            _refuse(path, f"camera '{camera}': a polygon needs three corners [x, y] or more", camera)
    return tuple(np.array([_pair(path, camera, corner) for corner in polygon]) for polygon in value)


def _pair(path: Path, camera: str, value: Any) -> tuple[float, float]:
    first = second = math.nan
    if isinstance(value, list) and len(value) == 2:  # 16 is the text "16", which would unpack into 1 and 6
        with suppress(TypeError, ValueError):
            first, second = float(value[0]), float(value[1])
    if not max(abs(first), abs(second)) < 1e6:  # also NaN; OpenCV takes 32-bit integers
        _refuse(path, f"camera '{camera}': expected two numbers in pixels, found {str(value)[:60]}", str(value)[:60])
    return first, second


def _refuse(path: Path, problem: str, value: object = None) -> NoReturn:
    problem = f"the file of the garbage masks {problem}" if not problem.startswith("camera") else problem
    fix = "Write it as in docs/guides/masks.md: cam01: {remove: [[[0, 0], [1920, 0], [1920, 200]]]}."
    raise StudioError("mask.garbage_file", problem, file=path, value=value, fix=fix, setting="capture.garbage_masks")
