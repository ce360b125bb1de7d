"""Garbage masks drawn as polygons, in one file for all cameras.

YAML (of which JSON is a subset), in pixels of the stored frames, with 0, 0 at the upper left corner of the image:

    cam01:
      remove: [[[0, 0], [1920, 0], [1920, 210], [0, 180]]]    # the performer is never in here
    cam02:
      keep: [[[300, 40], [1500, 40], [1500, 1060], [300, 1060]]]    # and never outside of these
      size: [1920, 1080]                                      # optional: size of the image that they were drawn on
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError, model_validator

from v3studio.studio.atomic_files import write_text
from v3studio.studio.bounded_files import TextError, read_bounded
from v3studio.studio.errors import StudioError, first_violation
from v3studio.studio.yaml_text import dump_yaml, parse_yaml

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


_Pixel = Annotated[float, Field(gt=-1e6, lt=1e6, allow_inf_nan=False)]  # OpenCV takes 32-bit integers
_Polygon = Annotated[list[tuple[_Pixel, _Pixel]], Field(min_length=3)]
_Polygons = Annotated[list[_Polygon], Field(min_length=1)]
_Side = Annotated[float, Field(ge=1, lt=1e6)]


class _Camera(BaseModel):
    model_config = ConfigDict(extra="forbid")

    keep: _Polygons = []
    remove: _Polygons = []
    size: tuple[_Side, _Side] | None = None

    @model_validator(mode="after")
    def _has_polygons(self) -> Self:
        if not (self.keep or self.remove):
            raise ValueError("has no polygons")
        return self


_FILE = TypeAdapter(Annotated[dict[str, _Camera], Field(min_length=1)])


def read_garbage_polygons(path: Path) -> dict[str, GarbagePolygons]:
    """The polygons of a file, by camera. Raises StudioError: `mask.garbage_file`."""
    what = "the file of the garbage masks"
    try:
        text = read_bounded(path).decode("utf-8-sig")
        cameras = _FILE.validate_python(parse_yaml(text, plain=True))  # plain: or camera 01 would become 1
    except OSError as error:
        problem = f"{what} cannot be read ({error.strerror})"
    except UnicodeDecodeError:
        problem = f"{what} is not text"
    except TextError as error:
        problem = f"{what} is not valid YAML ({error})"
    except ValidationError as error:
        problem = first_violation(error, what)[1]
    else:
        return {
            name: GarbagePolygons(tuple(map(np.array, own.keep)), tuple(map(np.array, own.remove)), own.size)
            for name, own in cameras.items()
        }
    fix = "Write it as in docs/guides/masks.md: cam01: {remove: [[[0, 0], [1920, 0], [1920, 200]]]}."
    raise StudioError("mask.garbage_file", problem, file=path, fix=fix, setting="capture.garbage_masks")


def write_garbage_polygons(path: Path, polygons: Mapping[str, GarbagePolygons]) -> None:
    """Write what `read_garbage_polygons` reads; cameras without polygons are left out. Raises OSError."""
    tree = {}
    for camera, own in polygons.items():
        lists = {"keep": own.keep, "remove": own.remove}
        entry: dict[str, Any] = {
            key: [np.round(polygon, 2).tolist() for polygon in value] for key, value in lists.items() if value
        }
        if entry:
            tree[camera] = entry | ({"size": list(own.size)} if own.size is not None else {})
    write_text(path, dump_yaml(tree, flow=None))
