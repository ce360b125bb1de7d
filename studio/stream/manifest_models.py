"""What the manifest says of files and groups, checked value by value. `docs/STREAM.md` describes it."""

from __future__ import annotations

import json
import math
import re
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from studio.errors import StudioError
from studio.stream.layout import Component, channels, components, plane_side, tile_side

# Bounds: far above any real stream, low enough that a hostile manifest cannot ask for all memory.
MAX_SPLATS = 4 << 20
MAX_GROUP_FRAMES = 10_000
MAX_FRAMES = 100_000_000
MAX_GROUPS = 1_000_000
MAX_FILE_BYTES = 1 << 30
MAX_MANIFEST_BYTES = 64 << 20
MAX_SIDE_BYTES = 256 << 20
MAX_PICTURE = 16384
MAX_VALUE = 1e9

Part = Literal["all", "high", "low", "low_mirrored"]
Number = Annotated[float, Field(ge=-MAX_VALUE, le=MAX_VALUE, allow_inf_nan=False)]
Step = Annotated[float, Field(gt=0, le=MAX_VALUE, allow_inf_nan=False)]
Point = tuple[Number, Number, Number]
Sha256 = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
_PATH = re.compile(r"[A-Za-z0-9_-][A-Za-z0-9._-]{0,99}(/[A-Za-z0-9_-][A-Za-z0-9._-]{0,99}){0,7}")


class Model(BaseModel):
    """Immutable, strict about types; keys that are not known are ignored."""

    model_config = ConfigDict(frozen=True, extra="ignore", strict=True)


class Box(Model):
    """Axis-aligned box, world units."""

    min: Point
    max: Point

    @model_validator(mode="after")
    def _check(self) -> Box:
        if any(low > high for low, high in zip(self.min, self.max, strict=True)):
            raise ValueError(f"box minimum {self.min} lies above its maximum {self.max}")
        return self

    def union(self, other: Box) -> Box:
        """The smallest box that holds both."""
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
        if not _PATH.fullmatch(self.path):
            raise ValueError(f"path {self.path[:200]!r} is not a plain relative path below the manifest's folder")
        return self


class VideoEntry(FileEntry):
    """A video file.

    Attributes:
        qp: quantization parameter it was encoded with, of the codec's own scale; 0 is lossless. For information.
    """

    qp: Annotated[int, Field(ge=0, le=63)]


class PlaneEntry(VideoEntry):
    """A video of one plane.

    Attributes:
        part: which byte of the component it holds: all (8 bits), high, low, or low_mirrored (255 - low wherever the
            high byte is odd).
    """

    part: Part


class ComponentEntry(Model):
    """One number a splat and its range: value = min + code * (max - min) / (255 or 65535)."""

    name: str
    min: Number
    max: Number
    planes: Annotated[tuple[PlaneEntry, ...], Field(min_length=1, max_length=2)]

    @model_validator(mode="after")
    def _check(self) -> ComponentEntry:
        if self.min > self.max:
            raise ValueError(f"range of {self.name} starts at {self.min}, above its end {self.max}")
        return self


class GroupEntry(Model):
    """One group: a run of frames with the same splats, decodable on its own.

    Attributes:
        index: 0-based, consecutive.
        first_frame: 0-based index in the stream of its first frame.
        frame_count: frames in each of its videos.
        splats: N, the same in each frame.
        sh_degree: 0 to 3.
        bounding_box: of all splat centers in all its frames.
        bytes: sum over its files.
    """

    index: Annotated[int, Field(ge=0, lt=MAX_GROUPS)]
    first_frame: Annotated[int, Field(ge=0, lt=MAX_FRAMES)]
    frame_count: Annotated[int, Field(ge=1, le=MAX_GROUP_FRAMES)]
    splats: Annotated[int, Field(ge=1, le=MAX_SPLATS)]
    sh_degree: Annotated[int, Field(ge=0, le=3)]
    bounding_box: Box
    bytes: Annotated[int, Field(ge=1)]

    @property
    def files(self) -> tuple[FileEntry, ...]:
        """All its files, in the order in which a player needs them."""
        raise NotImplementedError

    def check_bytes(self) -> None:
        """Raises ValueError where `bytes` is not the sum over the files."""
        total = sum(file.bytes for file in self.files)
        if self.bytes != total:
            raise ValueError(f"bytes is {self.bytes}, its files have {total}")

    @property
    def end_frame(self) -> int:
        """Index of the first frame after the group."""
        return self.first_frame + self.frame_count

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready form, read back by `from_dict`."""
        return self.model_dump(mode="json")

    @staticmethod
    def from_dict(values: dict[str, Any], name: str = "group entry") -> GroupEntry:
        """Inverse of `to_dict`; raises a StudioError that begins with `name` for anything else."""
        kind = MotionGroup if "channels" in values else PlanesGroup
        try:
            return kind.model_validate_json(json.dumps(values))
        except ValidationError as error:
            raise StudioError(f"{name}: {sentence(error)}; bake the group again.") from None


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
            raise ValueError(f"side {self.side} does not fit {self.splats} splats, expected {plane_side(self.splats)}")
        wanted = components(self.sh_degree)
        if tuple(entry.name for entry in self.components) != tuple(component.name for component in wanted):
            raise ValueError(f"components are not those of SH degree {self.sh_degree}, in order")
        for entry, component in zip(self.components, wanted, strict=True):
            _check_parts(entry, component)
        self.check_bytes()
        return self

    @property
    def planes(self) -> tuple[PlaneEntry, ...]:
        """All videos, in order of the components."""
        return tuple(plane for component in self.components for plane in component.planes)

    @property
    def files(self) -> tuple[FileEntry, ...]:
        """As `planes`."""
        return self.planes


class SideEntry(FileEntry):
    """The side file: keyframe positions, blocks, motions, classes and escapes.

    Attributes:
        raw_bytes: its size once decompressed.
    """

    raw_bytes: Annotated[int, Field(ge=1, le=MAX_SIDE_BYTES)]


class ChannelEntry(Model):
    """One tile of the picture: value = offset + (code - 128) * step, for the residuals times 2^class of the splat."""

    name: str
    offset: Number
    step: Step


class Lattice(Model):
    """Where keyframe positions lie: min + (cell + 1/2) * step for integer cells below 2^bits."""

    bits: Annotated[int, Field(ge=1, le=16)]
    min: Point
    step: Step


class BlockTable(Model):
    """Blocks and the units of their motions.

    Attributes:
        count: B.
        radius: divides places relative to a block's center, world units.
        step: one unit of an affine motion's numbers, world units.
        rotation_step: one unit of a mean rotation's three numbers.
    """

    count: Annotated[int, Field(ge=1, le=32767)]
    radius: Step
    step: Step
    rotation_step: Step


class MotionGroup(GroupEntry):
    """A group of the profile `motion`.

    Attributes:
        tile: side of a channel's square in the picture: the smallest multiple of 16 with tile^2 >= N.
        columns, rows: channel c is the tile in row c / columns, column c % columns.
        positions: units of the keyframe's positions.
        blocks: units of the blocks' motions.
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
            raise ValueError(f"tile {self.tile} does not fit {self.splats} splats, expected {tile_side(self.splats)}")
        wanted = channels(self.sh_degree)
        if tuple(entry.name for entry in self.channels) != wanted:
            raise ValueError(f"channels are not those of SH degree {self.sh_degree}, in order")
        if self.columns * self.rows < len(wanted):
            raise ValueError(f"{self.columns} x {self.rows} tiles do not hold {len(wanted)} channels")
        if max(self.size) > MAX_PICTURE:
            raise ValueError(f"the picture of {self.size[0]}x{self.size[1]} is larger than {MAX_PICTURE}")
        if self.blocks.count > self.splats:
            raise ValueError(f"{self.blocks.count} blocks for {self.splats} splats")
        if math.ldexp(self.positions.step, self.positions.bits) > 2 * MAX_VALUE:
            raise ValueError(f"positions reach beyond {MAX_VALUE:g}")
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
        raise ValueError(f"{entry.name} has the planes {parts}, expected {' or '.join(map(str, allowed))}")


def sentence(error: ValidationError) -> str:
    """The first finding of a failed check, on one line."""
    first = error.errors(include_url=False)[0]
    where = ".".join(str(part) for part in first["loc"])
    value = repr(first.get("input"))
    found = f", found {value[:80]}" if first["type"] not in ("value_error", "missing") else ""
    message = first["msg"].removeprefix("Value error, ")
    return f"{where + ': ' if where else ''}{message}{found}"
