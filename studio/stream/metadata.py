"""The entries of a manifest's free-form metadata that this program writes and reads."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeGuard

from studio.cameras import Camera
from studio.coverage import ViewRange
from studio.json_types import JsonObject

Triple = tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class StreamMetadata:
    """What a stream says about its presentation.

    Attributes:
        suggested_camera: a good first view; None if there is none.
        background: RGB, 0 to 1, drawn behind the splats; None if not said.
        up: direction that points up in the world; None if not said.
        view_range: from where the splats can be looked at; None if not said: from everywhere.
    """

    suggested_camera: Camera | None = None
    background: Triple | None = None
    up: Triple | None = None
    view_range: ViewRange | None = None

    def to_json(self) -> JsonObject:
        """The metadata for `write_manifest`. The order of keys is part of the stream's bytes."""
        values: JsonObject = {}
        if self.suggested_camera is not None:
            values["suggested_camera"] = self.suggested_camera.to_dict()
        if self.background is not None:
            values["background"] = list(self.background)
        if self.up is not None:
            values["up"] = list(self.up)
        if self.view_range is not None:
            values["view_range"] = self.view_range.to_json()
        return values

    @classmethod
    def from_json(cls, values: JsonObject) -> StreamMetadata:
        """Read a manifest's metadata, which may hold anything: entries that are malformed count as not given.

        Raises:
            StudioError: the suggested camera is invalid (see `Camera.from_dict`).
        """
        camera, background, up = (values.get(key) for key in ("suggested_camera", "background", "up"))
        return cls(
            suggested_camera=Camera.from_dict(camera) if isinstance(camera, dict) else None,
            background=(background[0], background[1], background[2]) if _is_vector(background) else None,
            up=(up[0], up[1], up[2]) if _is_vector(up) and any(up) else None,
            view_range=ViewRange.from_json(values.get("view_range")),
        )


def _is_vector(value: object) -> TypeGuard[list[float]]:
    return (
        isinstance(value, list)
        and len(value) == 3
        and all(isinstance(item, int | float) and math.isfinite(item) for item in value)
    )
