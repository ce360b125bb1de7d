"""The manifest: everything a player needs to know about a stream, as JSON, with bounds.

`docs/STREAM.md` specifies it, with the meaning of all fields; docstrings here only say what their names and types do
not. `manifest_file.manifest_schema` gives its JSON schema. Unknown keys are ignored, so that later writers can add
some; any change to the meaning of the bytes raises the version.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Sequence
from typing import Annotated, Any, Final, Literal

import numpy as np
from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    SerializerFunctionWrapHandler,
    ValidationError,
    field_validator,
    model_serializer,
    model_validator,
)

from v3studio.studio.counts import counted, short_repr
from v3studio.studio.dilation import DILATION, MAX_DILATION, MIN_DILATION
from v3studio.studio.errors import StudioError, violation
from v3studio.studio.json_types import JsonObject
from v3studio.studio.stream.attributes import MAX_VALUE, VERSION, channels, value_bounds
from v3studio.studio.stream.layout import tile_side

FORMAT: Final = "v3studio-stream"
PAGE_FORMAT: Final = "v3studio-stream-page"
MANIFEST_NAME: Final = "manifest.json"

FILES: Final = "files"  # folder of all files but the manifest
NAME_DIGITS: Final = 32  # digits of the SHA-256 in a file's name

# Bounds: far above any real stream, low enough that a malicious manifest cannot exhaust memory.
MAX_SPLATS = 4 << 20
MAX_GROUP_FRAMES = 10_000
MAX_FRAMES = 100_000_000
MAX_GROUPS = 1_000_000
MAX_FILE_BYTES = 1 << 30
MAX_MANIFEST_BYTES = 64 << 20
MAX_SIDE_BYTES = 256 << 20
MAX_PICTURE = 16384
MAX_BLOCK_SPAN = 1e6
"""Largest extent of the keyframe's lattice in units of `blocks.radius`; writers here stay below 65,537."""
MAX_RENDITIONS = 16
MAX_SET_PARTS = 16
MAX_PAGE_BYTES = 1 << 24
MAX_PAGE_GROUPS = 4096
MAX_AUDIO_BYTES = 1 << 28
MAX_AUDIO_SAMPLES = 1 << 32
MAX_FREE_BYTES = 1 << 20
MAX_FREE_DEPTH = 16

AUDIO_TOLERANCE: Final = 0.1  # seconds by which sound may be longer than the frames: a few frames of any codec

Number = Annotated[float, Field(ge=-MAX_VALUE, le=MAX_VALUE, allow_inf_nan=False)]
Step = Annotated[float, Field(gt=0, le=MAX_VALUE, allow_inf_nan=False)]
Point = tuple[Number, Number, Number]
FrameCount = Annotated[int, Field(ge=1, le=MAX_GROUP_FRAMES)]
Qp = Annotated[int, Field(ge=0, le=51)]
ShDegree = Annotated[int, Field(ge=0, le=3)]
SplatCount = Annotated[int, Field(ge=1, le=MAX_SPLATS)]
Decibels = Annotated[float, Field(ge=-1000, le=1000, allow_inf_nan=False)]
Sha256 = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
RenditionId = Annotated[str, Field(pattern=r"^[a-z0-9-]{1,32}$")]
Pruning = Literal["none", "importance", "fine-tuned"]

_PATH = re.compile(rf"{FILES}/([0-9a-f]{{{NAME_DIGITS}}})\.[a-z0-9]{{1,8}}")


class InconsistentError(ValueError):
    """Raised by validators for values that contradict each other. `rule` is a stable name for programs."""

    def __init__(self, rule: str, problem: str) -> None:
        super().__init__(problem)
        self.rule = rule


def _require(holds: bool, rule: str, problem: str) -> None:
    if not holds:
        raise InconsistentError(rule, problem)


class Model(BaseModel):
    """Immutable, strict types, unknown keys ignored."""

    model_config = ConfigDict(frozen=True, extra="ignore", strict=True)

    __repr__ = __str__ = short_repr

    def to_bytes(self) -> bytes:
        """JSON without spaces, with a final newline."""
        return compact(self.model_dump(mode="json"))


def compact(values: Any) -> bytes:
    """JSON without spaces, with a final newline."""
    return (json.dumps(values, separators=(",", ":"), allow_nan=False) + "\n").encode()


def point(values: np.ndarray) -> tuple[float, float, float]:
    """The first three numbers of an array as a `Point`."""
    return float(values[0]), float(values[1]), float(values[2])


class Box(Model):
    """Axis-aligned bounding box, world units."""

    min: Point
    max: Point

    @model_validator(mode="after")
    def _check(self) -> Box:
        ordered = all(low <= high for low, high in zip(self.min, self.max, strict=True))
        _require(ordered, "box_order", f"box minimum {self.min} exceeds its maximum {self.max}")
        return self

    def union(self, other: Box) -> Box:
        """The smallest box that contains both."""
        low = tuple(min(a, b) for a, b in zip(self.min, other.min, strict=True))
        high = tuple(max(a, b) for a, b in zip(self.max, other.max, strict=True))
        return Box.model_construct(min=low, max=high)


# Files


class FileEntry(Model):
    """One file of the stream: path relative to the manifest, named by the beginning of `sha256`, and size in bytes."""

    path: str
    bytes: Annotated[int, Field(ge=1, le=MAX_FILE_BYTES)]
    sha256: Sha256

    @model_validator(mode="after")
    def _check_path(self) -> FileEntry:
        match = _PATH.fullmatch(self.path)
        named = match is not None and match[1] == self.sha256[:NAME_DIGITS]
        _require(named, "path_not_hash", f"{self.path[:200]!r} is not named by the file's SHA-256")
        return self


class LumaCheck(Model):
    """CRC-32 of the decoded luma of one image of a video, so that players can verify that their decoder is exact."""

    picture: Annotated[int, Field(ge=0, lt=MAX_GROUP_FRAMES)]
    crc32: Annotated[int, Field(ge=0, lt=1 << 32)]


class VideoEntry(FileEntry):
    """The video: its QP (0 is lossless; informative), and checks of its first and a later image."""

    qp: Qp
    checks: Annotated[tuple[LumaCheck, ...], Field(min_length=1, max_length=2)]


class SideEntry(FileEntry):
    """The side file: keyframe positions, blocks, motions, classes and escapes. `raw_bytes`: its decompressed size."""

    raw_bytes: Annotated[int, Field(ge=1, le=MAX_SIDE_BYTES)]


class PageEntry(FileEntry):
    """A page of the index: a file with consecutive groups. `frames`: frame_count of each of them."""

    bytes: Annotated[int, Field(ge=1, le=MAX_PAGE_BYTES)]
    frames: Annotated[tuple[FrameCount, ...], Field(min_length=1, max_length=MAX_PAGE_GROUPS)]


class AudioEntry(FileEntry):
    """The sound, AAC-LC in an MP4 file. `samples`: per channel, without the encoder's delay and padding; `start`:
    seconds from the first frame to the first sample."""

    bytes: Annotated[int, Field(ge=1, le=MAX_AUDIO_BYTES)]
    codec: Literal["aac"]
    sample_rate: Annotated[int, Field(ge=8000, le=96_000)]
    channels: Annotated[int, Field(ge=1, le=2)]
    samples: Annotated[int, Field(ge=1, le=MAX_AUDIO_SAMPLES)]
    start: Annotated[float, Field(ge=0, le=MAX_FRAMES, allow_inf_nan=False)]

    @property
    def seconds(self) -> float:
        """Time from the first frame to the end of the sound."""
        return self.start + self.samples / self.sample_rate


# Groups


class ChannelEntry(Model):
    """One tile of the image: value = offset + (code - 128) * step; residuals are also scaled by 2^class of the
    splat."""

    name: str
    offset: Number
    step: Step

    @model_validator(mode="after")
    def _check(self) -> ChannelEntry:
        low, high = self.offset - 128 * self.step, self.offset + 127 * self.step
        least, most = value_bounds(self.name)
        _require(
            low >= least and high <= most,
            "value_range",
            f"values of {self.name[:40]} reach from {low:g} to {high:g}; they must be from {least:g} to {most:g}",
        )
        return self


class Lattice(Model):
    """Quantization of the keyframe's means: min + (cell + 1/2) * step for integer cells below 2^bits."""

    bits: Annotated[int, Field(ge=1, le=16)]
    min: Point
    step: Step


class BlockTable(Model):
    """Blocks (`count`: B) and the units of their motion. `radius`: scale of positions relative to the block's center;
    `step`: unit of the affine motion parameters (both in world units); `rotation_step`: unit of the mean rotation's
    MRP."""

    count: Annotated[int, Field(ge=1, le=32767)]
    radius: Step
    step: Step
    rotation_step: Step


class Rendition(Model):
    """One rendition of a group: an encoding of its frames that can be decoded without any other. `index` and
    `first_frame`: of the group, as there; `splats`: N, the same in each frame; `bounding_box`: of the means of all its
    frames; `bytes`: of all its files; `dilation`: see `Gaussians`, left out of the JSON where it is `DILATION`; `qp`:
    informative; `psnr_to_trained`: dB, None if not measured; `channels`: in the order of `attributes.channels`; `tile`:
    side of a channel's tile in pixels, the smallest multiple of 16 with tile^2 >= N; channel c is the tile in row
    c // `columns`, column c % `columns`; `positions`: quantization of the keyframe's means."""

    index: Annotated[int, Field(ge=0, lt=MAX_GROUPS)]
    first_frame: Annotated[int, Field(ge=0, lt=MAX_FRAMES)]
    frame_count: FrameCount
    splats: SplatCount
    sh_degree: ShDegree
    bounding_box: Box
    bytes: Annotated[int, Field(ge=1)]
    dilation: Annotated[float, Field(ge=MIN_DILATION, le=MAX_DILATION, allow_inf_nan=False)] = DILATION
    tile: Annotated[int, Field(ge=16)]
    columns: Annotated[int, Field(ge=1, le=64)]
    rows: Annotated[int, Field(ge=1, le=64)]
    positions: Lattice
    blocks: BlockTable
    channels: Annotated[tuple[ChannelEntry, ...], Field(max_length=64)]
    video: VideoEntry
    side: SideEntry
    id: RenditionId
    qp: Qp
    pruning: Pruning
    psnr_to_trained: Decibels | None

    @model_validator(mode="after")
    def _check(self) -> Rendition:
        tile = tile_side(self.splats)
        _require(self.tile == tile, "tile_side", f"tile is {self.tile}; {self.splats} splats require {tile}")
        wanted, own_names = channels(self.sh_degree), tuple(entry.name for entry in self.channels)
        _require(own_names == wanted, "channels", f"channels do not match SH degree {self.sh_degree} and its order")
        enough = self.columns * self.rows >= len(wanted)
        grid = f"{self.columns} x {self.rows} tiles"
        _require(enough, "tile_count", f"{grid} cannot hold {len(wanted)} channels")
        width, height = self.size
        fits = max(width, height) <= MAX_PICTURE
        _require(fits, "picture_size", f"picture size {width}x{height} exceeds {MAX_PICTURE} pixels per side")
        fits = self.blocks.count <= self.splats
        _require(fits, "block_count", f"{self.blocks.count} blocks for {self.splats} splats")
        span, radius = math.ldexp(self.positions.step, self.positions.bits), self.blocks.radius
        _require(span <= 2 * MAX_VALUE, "position_range", f"positions exceed {MAX_VALUE:g}")
        _require(
            span <= MAX_BLOCK_SPAN * radius,
            "block_radius",
            f"the blocks' radius is {radius:g}; a millionth of the positions' extent is {span / 1e6:g}",
        )
        total = self.video.bytes + self.side.bytes
        _require(self.bytes == total, "bytes_sum", f"bytes is {self.bytes}, but its files have {total} bytes")
        pictures = [check.picture for check in self.video.checks]
        ordered = pictures[0] == 0 and sorted(set(pictures)) == pictures and pictures[-1] < self.frame_count
        _require(ordered, "checks", f"checks are of pictures {pictures} of {self.frame_count}")
        return self

    @model_serializer(mode="wrap")
    def _serialize(self, handler: SerializerFunctionWrapHandler) -> JsonObject:
        values: JsonObject = handler(self)
        if self.dilation == DILATION:
            del values["dilation"]
        return values

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of its video."""
        return self.columns * self.tile, self.rows * self.tile

    @property
    def files(self) -> tuple[FileEntry, ...]:
        """Side file, then video, as a player needs them."""
        return self.side, self.video

    @property
    def end_frame(self) -> int:
        """Index of the first frame after the group."""
        return self.first_frame + self.frame_count


class GroupEntry(Model):
    """One group in all its renditions, the best first: consecutive frames that can be decoded without others. `index`,
    and `first_frame` in the stream: 0-based."""

    index: Annotated[int, Field(ge=0, lt=MAX_GROUPS)]
    first_frame: Annotated[int, Field(ge=0, lt=MAX_FRAMES)]
    frame_count: FrameCount
    renditions: Annotated[tuple[Rendition, ...], Field(min_length=1, max_length=MAX_RENDITIONS)]

    @model_validator(mode="after")
    def _check(self) -> GroupEntry:
        frames = (self.index, self.first_frame, self.frame_count)
        for rendition in self.renditions:
            _require(
                (rendition.index, rendition.first_frame, rendition.frame_count) == frames,
                "rendition_frames",
                f"rendition {rendition.id} of group {self.index} has index {rendition.index}, {rendition.frame_count} "
                f"frames from frame {rendition.first_frame} on; the group has {self.frame_count} from frame "
                f"{self.first_frame} on",
            )
        return self

    @property
    def end_frame(self) -> int:
        """Index of the first frame after the group."""
        return self.first_frame + self.frame_count

    @property
    def best(self) -> Rendition:
        """The first rendition."""
        return self.renditions[0]

    @property
    def files(self) -> tuple[FileEntry, ...]:
        """Files of all renditions, each once."""
        return tuple({file.path: file for rendition in self.renditions for file in rendition.files}.values())

    @classmethod
    def from_dict(cls, values: JsonObject) -> GroupEntry:
        """Make an entry from JSON values. Raises StudioError if they are invalid."""
        try:
            return cls.model_validate_json(json.dumps(values))
        except ValidationError as error:
            raise invalid(error, "group entry", "Bake the group again.") from None


class Page(Model):
    """A page of the index as stored."""

    format: Literal["v3studio-stream-page"]
    groups: Annotated[tuple[GroupEntry, ...], Field(min_length=1, max_length=MAX_PAGE_GROUPS)]


# The stream


class RenditionEntry(Model):
    """A rendition over the whole stream. `qp`, `splats`: the largest of its groups; `psnr_to_trained`: dB, mean over
    the measured frames, None if not measured; `bytes`: sum over its groups; `bandwidth`: bits per second at which its
    group with the highest rate arrives as fast as it plays."""

    id: RenditionId
    qp: Qp
    splats: SplatCount
    sh_degree: ShDegree
    pruning: Pruning
    psnr_to_trained: Decibels | None
    bytes: Annotated[int, Field(ge=1)]
    bandwidth: Annotated[int, Field(ge=1)]


class Manifest(Model):
    """The manifest as stored. `frame_count`, `bounding_box`: over all groups; `live`: groups are still being added;
    `renditions`: the best first, every group has them all; `groups`: the first ones, from frame 0; `pages`: where
    the others are; `settings`: of the bake, informative; `metadata`: free-form, see `metadata.StreamMetadata`, each
    at most 16 levels deep and 1 MiB; `total_bytes`: of all files of the stream, each once, including the manifest;
    `manifest_sha256`: of the manifest's bytes with these 64 digits replaced by zeros."""

    format: Literal["v3studio-stream"] = FORMAT
    version: Literal[VERSION] = VERSION  # type: ignore[valid-type]
    fps: Annotated[float, Field(gt=0, le=1000, allow_inf_nan=False)]
    frame_count: Annotated[int, Field(ge=1, le=MAX_FRAMES)]
    bounding_box: Box
    live: bool = False
    renditions: Annotated[tuple[RenditionEntry, ...], Field(min_length=1, max_length=MAX_RENDITIONS)]
    groups: Annotated[tuple[GroupEntry, ...], Field(min_length=1, max_length=MAX_GROUPS)]
    pages: Annotated[tuple[PageEntry, ...], Field(max_length=MAX_GROUPS)]
    set: Annotated[tuple[Rendition, ...], Field(max_length=MAX_SET_PARTS)] = ()
    audio: AudioEntry | None = None
    settings: JsonObject = Field(default_factory=dict)
    metadata: JsonObject = Field(default_factory=dict)
    total_bytes: Annotated[int, Field(ge=1)]
    manifest_sha256: Sha256

    @field_validator("settings", "metadata")
    @classmethod
    def _bounded(cls, value: JsonObject) -> JsonObject:
        level: list[Any] = [value]
        depth = 0
        while level:
            _require(depth <= MAX_FREE_DEPTH, "free_form", f"nested more than {MAX_FREE_DEPTH} levels deep")
            nested = [item for item in level if isinstance(item, dict | list)]
            level = [inner for item in nested for inner in (item.values() if isinstance(item, dict) else item)]
            depth += 1
        _require(len(compact(value)) <= MAX_FREE_BYTES, "free_form", f"more than {MAX_FREE_BYTES} bytes")
        return value

    @model_validator(mode="after")
    def _check(self) -> Manifest:
        ids = {rendition.id for rendition in self.renditions}
        _require(len(ids) == len(self.renditions), "rendition_ids", "two renditions have the same id")
        self.check_groups(self.groups, 0, 0)
        counts = self.frame_counts
        fits = len(counts) <= MAX_GROUPS
        _require(fits, "group_count", f"{counted(len(counts), 'group')}; the maximum is {MAX_GROUPS}")
        frames = sum(counts)
        same = frames == self.frame_count
        _require(same, "frame_count", f"frame_count is {self.frame_count}, the groups have {frames} frames")
        for number, part in enumerate(self.set):
            own = (part.index, part.first_frame, part.frame_count, part.sh_degree)
            _require(own == (number, 0, 1, 0), "set_part", f"part {number} of the set has more than a frame or a color")
        _require(sum(part.splats for part in self.set) <= MAX_SPLATS, "set_splats", f"a set above {MAX_SPLATS} splats")
        end = 0.0 if self.audio is None else self.audio.seconds
        _require(
            end <= self.duration + AUDIO_TOLERANCE,
            "audio_length",
            f"the sound ends at {end:.3f} s, the frames at {self.duration:.3f} s",
        )
        return self

    def check_groups(self, groups: Sequence[GroupEntry], number: int, frame: int) -> None:
        """Raises InconsistentError unless these groups follow each other from group `number` and frame `frame` on, and
        have the stream's renditions."""
        for group in groups:
            _require(
                (group.index, group.first_frame) == (number, frame),
                "group_order",
                f"group {number} has index {group.index} and starts at frame {group.first_frame}; expected index "
                f"{number} and frame {frame}",
            )
            same = [rendition.id for rendition in group.renditions] == [rendition.id for rendition in self.renditions]
            _require(same, "rendition_ids", f"group {number} does not have the stream's renditions")
            for rendition, stream in zip(group.renditions, self.renditions, strict=True):
                where = f"rendition {rendition.id} of group {number}"
                same = rendition.sh_degree == stream.sh_degree
                _require(same, "sh_degree", f"{where} has SH degree {rendition.sh_degree}; expected {stream.sh_degree}")
                fits = rendition.splats <= stream.splats
                _require(
                    fits, "rendition_splats", f"{where} has {rendition.splats} splats; at most {stream.splats} expected"
                )
            number, frame = number + 1, group.end_frame

    @property
    def frame_counts(self) -> tuple[int, ...]:
        """Frames of each group of the stream, also of those in pages."""
        return (*(group.frame_count for group in self.groups), *(count for page in self.pages for count in page.frames))

    @property
    def fixed_files(self) -> tuple[FileEntry, ...]:
        """Pages, sound and set."""
        sound = () if self.audio is None else (self.audio,)
        return (*self.pages, *sound, *(file for part in self.set for file in part.files))

    @property
    def duration(self) -> float:
        """Seconds."""
        return self.frame_count / self.fps

    @property
    def set_bytes(self) -> int:
        """Bytes of the set, which is sent once."""
        return sum(part.bytes for part in self.set)

    def played_bytes(self) -> int:
        """Bytes that playing the best rendition takes, without the set: its files, pages, sound and manifest."""
        fixed = sum(file.bytes for file in self.fixed_files) - self.set_bytes
        return self.renditions[0].bytes + fixed + len(self.to_bytes())


def invalid(error: ValidationError, file: str, fix: str) -> StudioError:
    """The error for the first finding of a failed validation. Its fields: `location`, the dotted path of the value or
    of the inconsistent object ("" for the whole file), and `rule`, the violated one (pydantic's, or of an
    `InconsistentError`)."""
    first = error.errors(include_url=False)[0]
    location = ".".join(str(part) for part in first["loc"])
    message, rule = violation(first), first["type"]
    value: str | None = None
    ending = ""
    cause = first.get("ctx", {}).get("error")
    if isinstance(cause, InconsistentError):
        message, rule = str(cause), cause.rule
    elif rule != "missing":
        value = repr(first.get("input"))[:80]
        ending = f", found {value}"
    problem = (
        f"{location + (' ' if message.startswith(('must', 'is ')) else ': ') if location else ''}{message}{ending}"
    )
    return StudioError("manifest.invalid", problem, file=file, value=value, fix=fix, location=location, rule=rule)
