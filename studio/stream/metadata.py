"""The entries of a manifest's free-form metadata that this program writes and reads."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, TypeGuard

import numpy as np

from v3studio.studio.calibration.coverage import ViewRange
from v3studio.studio.cameras import Camera
from v3studio.studio.errors import plain_text
from v3studio.studio.json_types import JsonObject
from v3studio.studio.similarity import Similarity

Triple = tuple[float, float, float]

_DECIMALS = 9  # of poses and directions; further ones depend on the kernels that BLAS chooses for a processor
MOST_FRAMES = 10_000_000  # largest `CapturePlace.first_frame` that is believed
TEXTS = ("title", "credits", "license", "description")  # entries that are shown as text


def with_plain_texts(values: Mapping[str, Any]) -> JsonObject:
    """Metadata with `plain_text` of each of the `TEXTS`; what is not text stays as it is."""
    plain = {name: plain_text(values[name]) for name in TEXTS if isinstance(values.get(name), str)}
    return {**values, **plain}


@dataclass(frozen=True, eq=False)
class CapturePlace:
    """The place of an edited stream in the take that it was baked from: the take's frame, from 0, that is frame 0 of
    the stream, and the similarity from the world of the capture to that of the stream."""

    first_frame: int = 0
    world: Similarity = field(default_factory=Similarity)

    def camera(self, camera: Camera) -> Camera:
        """A camera of the capture, in the world of the stream."""
        return camera if self.world.is_identity else self.world.camera(camera)

    def to_json(self) -> JsonObject:
        """Return JSON values for the stream's metadata, as docs/STREAM.md describes them."""
        return {"first_frame": self.first_frame, **self.world.to_json()}

    @classmethod
    def from_json(cls, values: Any) -> CapturePlace | None:
        """Read `to_json`; None if it is malformed."""
        world = Similarity.from_json(values)
        if world is None:
            return None
        first = values.get("first_frame")
        return cls(first, world) if type(first) is int and 0 <= first <= MOST_FRAMES else None


@dataclass(frozen=True, eq=False)
class StreamMetadata:
    """The words of a stream about its presentation.

    Attributes:
        suggested_camera: a good first view; None if there is none.
        background: RGB, 0 to 1, drawn behind the splats; None if not said.
        up: direction that points up in the world; None if not said.
        view_range: from where the splats can be looked at; None if not said: from everywhere.
        capture: where the stream lies in its take; None: it has the take's frames and world.
        original: from the world of the stream to that of the file with the cameras or the imported splats, if they
            differ; exports apply it.
    """

    suggested_camera: Camera | None = None
    background: Triple | None = None
    up: Triple | None = None
    view_range: ViewRange | None = None
    capture: CapturePlace | None = None
    original: Similarity = field(default_factory=Similarity)

    def to_json(self) -> JsonObject:
        """The metadata for `write_manifest`. The order of keys is part of the stream's bytes."""
        values: JsonObject = {}
        if self.suggested_camera is not None:
            camera = self.suggested_camera.to_dict()
            for name in ("K", "world_to_camera"):
                camera[name] = np.round(camera[name], _DECIMALS).tolist()
            values["suggested_camera"] = camera
        if self.background is not None:
            values["background"] = list(self.background)
        if self.up is not None:
            values["up"] = np.round(self.up, _DECIMALS).tolist()
        if self.view_range is not None:
            values["view_range"] = self.view_range.to_json()
        if self.capture is not None:
            values["capture"] = self.capture.to_json()
        if not self.original.is_identity:
            values["original"] = self.original.to_json()
        return values

    @classmethod
    def from_json(cls, values: JsonObject) -> StreamMetadata:
        """Read a manifest's metadata, which may hold anything: malformed entries count as not given. StudioError if the
        suggested camera is invalid (see `Camera.from_dict`)."""
        original = Similarity.from_json(values.get("original"))
        if original is None or not np.array_equal(original.rotation, np.eye(3)):  # own frames never have a rotation
            original = Similarity()
        camera, background, up = (values.get(key) for key in ("suggested_camera", "background", "up"))
        return cls(
            suggested_camera=Camera.from_dict(camera) if isinstance(camera, dict) else None,
            background=(background[0], background[1], background[2]) if _is_color(background) else None,
            up=(up[0], up[1], up[2]) if _is_vector(up) and any(up) else None,
            view_range=ViewRange.from_json(values.get("view_range")),
            capture=CapturePlace.from_json(values.get("capture")),
            original=original,
        )


def _is_color(value: object) -> TypeGuard[list[float]]:
    return _is_vector(value) and all(0 <= item <= 1 for item in value)


def _is_vector(value: object) -> TypeGuard[list[float]]:
    return (
        isinstance(value, list)
        and len(value) == 3
        and all(type(item) in (int, float) and math.isfinite(item) for item in value)
    )
