"""Models of the manifest's files and groups, with bounds. `docs/STREAM.md` specifies them."""

from __future__ import annotations

import json
import math
import re
from typing import Annotated, Literal

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    SerializerFunctionWrapHandler,
    ValidationError,
    model_serializer,
    model_validator,
)

from studio.dilation import DILATION, MAX_DILATION, MIN_DILATION
from studio.errors import StudioError
from studio.json_types import JsonObject
from studio.stream.layout import Component, channels, components, plane_side, tile_side
from studio.violations import violation

# Bounds: far above any real stream, low enough that a malicious manifest cannot exhaust memory.
MAX_SPLATS = 4 << 20
MAX_GROUP_FRAMES = 10_000
MAX_FRAMES = 100_000_000
MAX_GROUPS = 1_000_000
MAX_FILE_BYTES = 1 << 30
MAX_MANIFEST_BYTES = 64 << 20
MAX_SIDE_BYTES = 256 << 20
MAX_PICTURE = 16384
MAX_VALUE = 1e9
MAX_LOG_SCALE = math.log(MAX_VALUE)
MAX_BLOCK_SPAN = 1e6
"""Largest extent of the keyframe's lattice in units of `blocks.radius`; writers here stay below 65,537."""

Part = Literal["all", "high", "low", "low_mirrored"]
Number = Annotated[float, Field(ge=-MAX_VALUE, le=MAX_VALUE, allow_inf_nan=False)]
Step = Annotated[float, Field(gt=0, le=MAX_VALUE, allow_inf_nan=False)]
Point = tuple[Number, Number, Number]
Sha256 = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
PATH = re.compile(r"[A-Za-z0-9_-][A-Za-z0-9._-]{0,99}(/[A-Za-z0-9_-][A-Za-z0-9._-]{0,99}){0,7}")


class InconsistentError(ValueError):
    """Raised by validators for values that contradict each other. `rule` is a stable name for programs."""

    def __init__(self, rule: str, problem: str) -> None:
        super().__init__(problem)
        self.rule = rule


def largest(name: str) -> float:
    """The largest value of a component or channel that can be drawn: scales end at `MAX_VALUE`, as positions do."""
    return MAX_LOG_SCALE if name.startswith("log_scale") else MAX_VALUE


class Model(BaseModel):
    """Immutable, strict types, unknown keys ignored."""

    model_config = ConfigDict(frozen=True, extra="ignore", strict=True)


class Box(Model):
    """Axis-aligned bounding box, world units."""

    min: Point
    max: Point

    @model_validator(mode="after")
    def _check(self) -> Box:
        if any(low > high for low, high in zip(self.min, self.max, strict=True)):
            raise InconsistentError("box_order", f"box minimum {self.min} exceeds its maximum {self.max}")
        return self

    def union(self, other: Box) -> Box:
        """The smallest box that contains both."""
        low = tuple(min(a, b) for a, b in zip(self.min, other.min, strict=True))
        high = tuple(max(a, b) for a, b in zip(self.max, other.max, strict=True))
        return Box.model_construct(min=low, max=high)


class FileEntry(Model):
    """One file of a group.

    Attributes:
        path: relative to the manifest, with slashes.
        bytes, sha256: size and SHA-256 of the file.
    """

    path: str
    bytes: Annotated[int, Field(ge=1, le=MAX_FILE_BYTES)]
    sha256: Sha256

    @model_validator(mode="after")
    def _check(self) -> FileEntry:
        if not PATH.fullmatch(self.path):
            raise InconsistentError(
                "unsafe_path", f"{self.path[:200]!r} is not a plain relative path below the manifest's folder"
            )
        return self


class VideoEntry(FileEntry):
    """A video file.

    Attributes:
        qp: quantization parameter on the codec's own scale, 0 is lossless; informative.
    """

    qp: Annotated[int, Field(ge=0, le=63)]


class PlaneEntry(VideoEntry):
    """The video of one plane.

    Attributes:
        part: byte of the component: all (8 bits), high, low, or low_mirrored (255 - low where the high byte is odd).
    """

    part: Part


class ComponentEntry(Model):
    """One number per splat and its range: value = min + code * (max - min) / (255 or 65535)."""

    name: str
    min: Number
    max: Number
    planes: Annotated[tuple[PlaneEntry, ...], Field(min_length=1, max_length=2)]

    @model_validator(mode="after")
    def _check(self) -> ComponentEntry:
        if self.min > self.max:
            raise InconsistentError("range_order", f"minimum {self.min} of {self.name} exceeds its maximum {self.max}")
        if self.max > largest(self.name):
            raise InconsistentError(
                "value_range", f"maximum {self.max:g} of {self.name[:40]} exceeds {largest(self.name):g}"
            )
        return self


class GroupEntry(Model):
    """One group: consecutive frames with the same splats, decodable independently.

    Attributes:
        index: 0-based, consecutive.
        first_frame: index of its first frame in the stream, 0-based.
        frame_count: number of frames, the same in each video.
        splats: N, the same in each frame.
        sh_degree: 0 to 3.
        bounding_box: of the means of all its frames.
        bytes: total size of its files.
        dilation: of its splats, see `Gaussians`. Left out of the JSON where it is `DILATION`.
    """

    index: Annotated[int, Field(ge=0, lt=MAX_GROUPS)]
    first_frame: Annotated[int, Field(ge=0, lt=MAX_FRAMES)]
    frame_count: Annotated[int, Field(ge=1, le=MAX_GROUP_FRAMES)]
    splats: Annotated[int, Field(ge=1, le=MAX_SPLATS)]
    sh_degree: Annotated[int, Field(ge=0, le=3)]
    bounding_box: Box
    bytes: Annotated[int, Field(ge=1)]
    dilation: Annotated[float, Field(ge=MIN_DILATION, le=MAX_DILATION, allow_inf_nan=False)] = DILATION

    @model_serializer(mode="wrap")
    def _without_default(self, handler: SerializerFunctionWrapHandler) -> JsonObject:
        values: JsonObject = handler(self)
        if self.dilation == DILATION:
            del values["dilation"]
        return values

    @property
    def files(self) -> tuple[FileEntry, ...]:
        """All its files, in the order that a player needs them."""
        raise NotImplementedError

    def check_bytes(self) -> None:
        """Raises ValueError if `bytes` is not the total size of the files."""
        total = sum(file.bytes for file in self.files)
        if self.bytes != total:
            raise InconsistentError("bytes_sum", f"bytes is {self.bytes}, but its files have {total} bytes")

    @property
    def end_frame(self) -> int:
        """Index of the first frame after the group."""
        return self.first_frame + self.frame_count

    def to_dict(self) -> JsonObject:
        """JSON-ready values, the inverse of `from_dict`."""
        return self.model_dump(mode="json")

    @staticmethod
    def from_dict(values: JsonObject, name: str = "group entry") -> GroupEntry:
        """Inverse of `to_dict`. Raises StudioError, with `name` as the file, for invalid values."""
        kind = MotionGroup if "channels" in values else PlanesGroup
        try:
            return kind.model_validate_json(json.dumps(values))
        except ValidationError as error:
            raise invalid(error, name, "Bake the group again.") from None


class PlanesGroup(GroupEntry):
    """A group of the profile `planes`.

    Attributes:
        side: side of the planes in pixels: the smallest multiple of 8 with side^2 >= N.
        components: in the order of `layout.components(sh_degree)`.
    """

    side: Annotated[int, Field(ge=8)]
    components: Annotated[tuple[ComponentEntry, ...], Field(max_length=64)]

    @model_validator(mode="after")
    def _check(self) -> PlanesGroup:
        if self.side != plane_side(self.splats):
            raise InconsistentError(
                "plane_side", f"side is {self.side}; {self.splats} splats require {plane_side(self.splats)}"
            )
        wanted = components(self.sh_degree)
        if tuple(entry.name for entry in self.components) != tuple(component.name for component in wanted):
            raise InconsistentError("components", f"components do not match SH degree {self.sh_degree} and its order")
        for entry, component in zip(self.components, wanted, strict=True):
            _check_parts(entry, component)
        self.check_bytes()
        return self

    @property
    def planes(self) -> tuple[PlaneEntry, ...]:
        """All videos, in the order of the components."""
        return tuple(plane for component in self.components for plane in component.planes)

    @property
    def files(self) -> tuple[FileEntry, ...]:
        """Same as `planes`."""
        return self.planes


class SideEntry(FileEntry):
    """The side file: keyframe positions, blocks, motions, classes and escapes.

    Attributes:
        raw_bytes: its decompressed size.
    """

    raw_bytes: Annotated[int, Field(ge=1, le=MAX_SIDE_BYTES)]


class ChannelEntry(Model):
    """One tile of the picture: value = offset + (code - 128) * step; residuals are also scaled by 2^class of the
    splat."""

    name: str
    offset: Number
    step: Step

    @model_validator(mode="after")
    def _check(self) -> ChannelEntry:
        low, high = self.offset - 128 * self.step, self.offset + 127 * self.step
        if low < -MAX_VALUE or high > largest(self.name):
            raise InconsistentError(
                "value_range",
                f"values of {self.name[:40]} reach from {low:g} to {high:g}; they must be from {-MAX_VALUE:g} to "
                f"{largest(self.name):g}",
            )
        return self


class Lattice(Model):
    """Quantization of the keyframe's means: min + (cell + 1/2) * step for integer cells below 2^bits."""

    bits: Annotated[int, Field(ge=1, le=16)]
    min: Point
    step: Step


class BlockTable(Model):
    """Blocks and the units of their motion.

    Attributes:
        count: B.
        radius: scale of positions relative to the block's center, world units.
        step: unit of the affine motion parameters, world units.
        rotation_step: unit of the mean rotation's MRP.
    """

    count: Annotated[int, Field(ge=1, le=32767)]
    radius: Step
    step: Step
    rotation_step: Step


class MotionGroup(GroupEntry):
    """A group of the profile `motion`.

    Attributes:
        tile: side of a channel's tile in pixels: the smallest multiple of 16 with tile^2 >= N.
        columns, rows: channel c is the tile in row c // columns, column c % columns.
        positions: quantization of the keyframe's means.
        blocks: number and units of the block motion.
        channels: in the order of `layout.channels(sh_degree)`.
        video, side: the files.
    """

    tile: Annotated[int, Field(ge=16)]
    columns: Annotated[int, Field(ge=1, le=64)]
    rows: Annotated[int, Field(ge=1, le=64)]
    positions: Lattice
    blocks: BlockTable
    channels: Annotated[tuple[ChannelEntry, ...], Field(max_length=64)]
    video: VideoEntry
    side: SideEntry

    @model_validator(mode="after")
    def _check(self) -> MotionGroup:
        if self.tile != tile_side(self.splats):
            raise InconsistentError(
                "tile_side", f"tile is {self.tile}; {self.splats} splats require {tile_side(self.splats)}"
            )
        wanted = channels(self.sh_degree)
        if tuple(entry.name for entry in self.channels) != wanted:
            raise InconsistentError("channels", f"channels do not match SH degree {self.sh_degree} and its order")
        if self.columns * self.rows < len(wanted):
            raise InconsistentError(
                "tile_count", f"{self.columns} x {self.rows} tiles cannot hold {len(wanted)} channels"
            )
        if max(self.size) > MAX_PICTURE:
            raise InconsistentError(
                "picture_size", f"picture size {self.size[0]}x{self.size[1]} exceeds {MAX_PICTURE} pixels per side"
            )
        if self.blocks.count > self.splats:
            raise InconsistentError("block_count", f"{self.blocks.count} blocks for {self.splats} splats")
        if math.ldexp(self.positions.step, self.positions.bits) > 2 * MAX_VALUE:
            raise InconsistentError("position_range", f"positions exceed {MAX_VALUE:g}")
        span = math.ldexp(self.positions.step, self.positions.bits)
        if span > MAX_BLOCK_SPAN * self.blocks.radius:
            raise InconsistentError(
                "block_radius",
                f"the blocks' radius is {self.blocks.radius:g}; a millionth of the positions' extent is {span / 1e6:g}",
            )
        self.check_bytes()
        return self

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the picture."""
        return self.columns * self.tile, self.rows * self.tile

    @property
    def files(self) -> tuple[FileEntry, ...]:
        """Side file, then video."""
        return self.side, self.video


def _check_parts(entry: ComponentEntry, component: Component) -> None:
    parts = tuple(plane.part for plane in entry.planes)
    allowed = (("all",),) if component.bits == 8 else (("high", "low"), ("high", "low_mirrored"))
    if parts not in allowed:
        raise InconsistentError("parts", f"{entry.name} has planes {parts}; expected {' or '.join(map(str, allowed))}")


def group_invalid(group: int, error: ValueError) -> StudioError:
    """The error for a baked group with values that the manifest cannot represent."""
    problem = invalid(error, "", "").problem if isinstance(error, ValidationError) else str(error)
    return StudioError(
        "bake.group_invalid",
        f"group {group} cannot be represented in the format ({problem})",
        fix="Train the group again.",
        group=group,
    )


def invalid(error: ValidationError, file: str, fix: str) -> StudioError:
    """The error for the first finding of a failed validation.

    Its fields: `location`, the dotted path of the value or of the inconsistent object ("" for the whole file), and
    `rule`, the name of the violated rule (pydantic's, or that of an `InconsistentError`).
    """
    first = error.errors(include_url=False)[0]
    location = ".".join(str(part) for part in first["loc"])
    message, rule = violation(first), first["type"]
    value: str | None = None
    found = ""
    cause = first.get("ctx", {}).get("error")
    if isinstance(cause, InconsistentError):
        message, rule = str(cause), cause.rule
    elif rule != "missing":
        value = repr(first.get("input"))[:80]
        found = f", found {value}"
    return StudioError(
        "manifest.invalid",
        f"{location + (' ' if message.startswith(('must', 'is ')) else ': ') if location else ''}{message}{found}",
        file=file,
        value=value,
        fix=fix,
        location=location,
        rule=rule,
    )
