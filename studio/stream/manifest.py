"""The manifest: everything a player must know of a stream, as JSON, checked before anything else is read.

`docs/STREAM.md` describes it for writers of other players. Keys that version 1 does not know are ignored, so that
later writers may add some; whatever changes the meaning of the bytes raises the version.
"""

from __future__ import annotations

import hashlib
import json
import re
from typing import Annotated, Any, Final, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from studio.errors import StudioError
from studio.stream.layout import Component, components, plane_side

FORMAT: Final = "v3studio-stream"
VERSION = 1
MANIFEST_NAME = "manifest.json"

# Bounds: far above any real stream, low enough that a hostile manifest cannot ask for all memory.
MAX_SPLATS = 4 << 20
MAX_GROUP_FRAMES = 10_000
MAX_FRAMES = 100_000_000
MAX_GROUPS = 1_000_000
MAX_FILE_BYTES = 1 << 30
MAX_MANIFEST_BYTES = 64 << 20
MAX_VALUE = 1e9

Part = Literal["all", "high", "low", "low_mirrored"]
Number = Annotated[float, Field(ge=-MAX_VALUE, le=MAX_VALUE, allow_inf_nan=False)]
Point = tuple[Number, Number, Number]
Sha256 = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
_PATH = re.compile(r"[A-Za-z0-9_-][A-Za-z0-9._-]{0,99}(/[A-Za-z0-9_-][A-Za-z0-9._-]{0,99}){0,7}")


class _Model(BaseModel):
    model_config = ConfigDict(frozen=True, extra="ignore", strict=True)


class Box(_Model):
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


class PlaneEntry(_Model):
    """One video file.

    Attributes:
        path: relative to the manifest, with slashes.
        part: which byte of the component it holds: all (8 bits), high, low, or low_mirrored (255 - low wherever the
            high byte is odd).
        qp: quantisation parameter it was encoded with; 0 is lossless. For information.
        bytes, sha256: size and SHA-256 of the file.
    """

    path: str
    part: Part
    qp: Annotated[int, Field(ge=0, le=51)]
    bytes: Annotated[int, Field(ge=1, le=MAX_FILE_BYTES)]
    sha256: Sha256

    @model_validator(mode="after")
    def _check(self) -> PlaneEntry:
        if not _PATH.fullmatch(self.path):
            raise ValueError(f"path {self.path[:200]!r} is not a plain relative path below the manifest's folder")
        return self


class ComponentEntry(_Model):
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


class GroupEntry(_Model):
    """One group: a run of frames with the same splats, decodable on its own.

    Attributes:
        index: 0-based, consecutive.
        first_frame: 0-based index in the stream of its first frame.
        frame_count: frames in each of its files.
        splats: N, the same in each frame.
        side: side of the planes in pixels: the smallest multiple of 8 with side^2 >= N.
        bounding_box: of all splat centres in all its frames.
        bytes: sum over its files.
        components: in the order of `layout.components(sh_degree)`.
    """

    index: Annotated[int, Field(ge=0, lt=MAX_GROUPS)]
    first_frame: Annotated[int, Field(ge=0, lt=MAX_FRAMES)]
    frame_count: Annotated[int, Field(ge=1, le=MAX_GROUP_FRAMES)]
    splats: Annotated[int, Field(ge=1, le=MAX_SPLATS)]
    sh_degree: Annotated[int, Field(ge=0, le=3)]
    side: Annotated[int, Field(ge=8)]
    bounding_box: Box
    bytes: Annotated[int, Field(ge=1)]
    components: Annotated[tuple[ComponentEntry, ...], Field(max_length=64)]

    @model_validator(mode="after")
    def _check(self) -> GroupEntry:
        if self.side != plane_side(self.splats):
            raise ValueError(f"side {self.side} does not fit {self.splats} splats, expected {plane_side(self.splats)}")
        wanted = components(self.sh_degree)
        if tuple(entry.name for entry in self.components) != tuple(component.name for component in wanted):
            raise ValueError(f"components are not those of SH degree {self.sh_degree}, in order")
        for entry, component in zip(self.components, wanted, strict=True):
            _check_parts(entry, component)
        total = sum(plane.bytes for plane in self.planes)
        if self.bytes != total:
            raise ValueError(f"bytes is {self.bytes}, its files have {total}")
        return self

    @property
    def planes(self) -> tuple[PlaneEntry, ...]:
        """All files, in order of the components."""
        return tuple(plane for component in self.components for plane in component.planes)

    @property
    def end_frame(self) -> int:
        """Index of the first frame after the group."""
        return self.first_frame + self.frame_count

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready form, read back by `from_dict`."""
        return self.model_dump(mode="json")

    @classmethod
    def from_dict(cls, values: dict[str, Any], name: str = "group entry") -> GroupEntry:
        """Inverse of `to_dict`; raises a StudioError that begins with `name` for anything else."""
        try:
            return cls.model_validate_json(json.dumps(values))
        except ValidationError as error:
            raise StudioError(f"{name}: {_sentence(error)}; bake the group again.") from None


def _check_parts(entry: ComponentEntry, component: Component) -> None:
    parts = tuple(plane.part for plane in entry.planes)
    allowed = (("all",),) if component.bits == 8 else (("high", "low"), ("high", "low_mirrored"))
    if parts not in allowed:
        raise ValueError(f"{entry.name} has the planes {parts}, expected {' or '.join(map(str, allowed))}")


class Codec(_Model):
    """How the videos are encoded; fixed in version 1."""

    name: Literal["h264"] = "h264"
    pixel_format: Literal["yuv420p"] = "yuv420p"
    color_range: Literal["full"] = "full"


class Manifest(_Model):
    """The whole stream.

    Attributes:
        format, version, profile: "v3studio-stream", 1, "planes".
        fps: frames a second to play at.
        frame_count: over all groups.
        sh_degree: 0 to 3, the same in all groups.
        scan: how splat i lies on a plane; "rows": at row i // side, column i % side.
        bounding_box: over all groups.
        groups: in order, without gaps, from frame 0.
        settings: what it was baked with. For information.
        metadata: free; "suggested_camera" holds a camera as in rig.json where there is one.
        total_bytes: all files of the stream, this one included.
        manifest_sha256: of this file's bytes with these 64 digits replaced by zeros.
    """

    format: Literal["v3studio-stream"] = FORMAT
    version: Literal[1] = 1
    profile: Literal["planes"] = "planes"
    fps: Annotated[float, Field(gt=0, le=1000, allow_inf_nan=False)]
    frame_count: Annotated[int, Field(ge=1, le=MAX_FRAMES)]
    sh_degree: Annotated[int, Field(ge=0, le=3)]
    scan: Literal["rows"] = "rows"
    codec: Codec = Codec()
    bounding_box: Box
    groups: Annotated[tuple[GroupEntry, ...], Field(min_length=1, max_length=MAX_GROUPS)]
    settings: dict[str, Any] = {}
    metadata: dict[str, Any] = {}
    total_bytes: Annotated[int, Field(ge=1)]
    manifest_sha256: Sha256

    @model_validator(mode="after")
    def _check(self) -> Manifest:
        frame = 0
        paths: set[str] = set()
        for number, group in enumerate(self.groups):
            if group.index != number or group.first_frame != frame:
                raise ValueError(
                    f"group {number} has index {group.index} and begins at frame {group.first_frame}, expected index "
                    f"{number} at frame {frame}"
                )
            if group.sh_degree != self.sh_degree:
                raise ValueError(f"group {number} has SH degree {group.sh_degree}, the stream {self.sh_degree}")
            frame = group.end_frame
            for plane in group.planes:
                if plane.path in paths or plane.path == MANIFEST_NAME:
                    raise ValueError(f"path {plane.path!r} is used twice")
                paths.add(plane.path)
        if frame != self.frame_count:
            raise ValueError(f"frame_count is {self.frame_count}, the groups have {frame} frames")
        return self

    def group_of(self, frame: int) -> GroupEntry:
        """The group that holds a frame, by bisection. Raises StudioError outside 0 to frame_count - 1."""
        if not 0 <= frame < self.frame_count:
            raise StudioError(f"The stream has the frames 0 to {self.frame_count - 1}; there is no frame {frame}.")
        low, high = 0, len(self.groups) - 1
        while low < high:
            middle = (low + high + 1) // 2
            if self.groups[middle].first_frame <= frame:
                low = middle
            else:
                high = middle - 1
        return self.groups[low]

    @property
    def duration(self) -> float:
        """Seconds."""
        return self.frame_count / self.fps

    @property
    def bytes_per_frame(self) -> float:
        """Total bytes over frames."""
        return self.total_bytes / self.frame_count

    def to_bytes(self) -> bytes:
        """The manifest as it stands in its file (sum and size must already be filled in, see `seal`)."""
        return (json.dumps(self.model_dump(mode="json"), indent=1, allow_nan=False) + "\n").encode()


def seal(manifest: Manifest) -> tuple[Manifest, bytes]:
    """Fill in `total_bytes` and `manifest_sha256`, which depend on the file's own bytes.

    Returns:
        the manifest, and the bytes to write.
    """
    files = sum(group.bytes for group in manifest.groups)
    zeros = "0" * 64
    total = files
    while True:  # the size depends on its own digits; it only grows, so it stands still after a few rounds
        draft = manifest.model_copy(update={"total_bytes": total, "manifest_sha256": zeros})
        data = draft.to_bytes()
        if files + len(data) == total:
            break
        total = files + len(data)
    digest = hashlib.sha256(data).hexdigest()
    sealed = draft.model_copy(update={"manifest_sha256": digest})
    return sealed, data.replace(zeros.encode(), digest.encode(), 1)


def parse_manifest(data: bytes, name: str) -> Manifest:
    """Read and check a manifest.

    Args:
        data: the file.
        name: for messages.

    Raises:
        StudioError: not JSON, another format, a newer version, a value out of bounds, a path that leads out of the
            folder, or bytes that do not fit the manifest's own checksum.
    """
    try:
        head = json.loads(data)
    except (ValueError, RecursionError) as error:
        raise StudioError(f"{name}: this is not readable JSON ({error}); bake or fetch the stream again.") from None
    if not isinstance(head, dict) or head.get("format") != FORMAT:
        raise StudioError(f"{name}: this is not the manifest of a {FORMAT}; choose the folder of a baked stream.")
    version = head.get("version")
    if isinstance(version, int) and not isinstance(version, bool) and version > VERSION:
        raise StudioError(
            f"{name}: the stream has format version {version}, this program reads up to {VERSION}; update V3 Studio."
        )
    try:
        manifest = Manifest.model_validate_json(data)
    except ValidationError as error:
        raise StudioError(f"{name}: {_sentence(error)}; bake or fetch the stream again.") from None
    digest = manifest.manifest_sha256
    blanked = data.replace(digest.encode(), b"0" * 64)
    if hashlib.sha256(blanked).hexdigest() != digest:
        raise StudioError(f"{name}: the bytes do not fit their own SHA-256, so the file was damaged or edited.")
    expected = sum(group.bytes for group in manifest.groups) + len(data)
    if manifest.total_bytes != expected:
        raise StudioError(f"{name}: total_bytes is {manifest.total_bytes}, the stream's files have {expected}.")
    return manifest


def _sentence(error: ValidationError) -> str:
    """The first finding, on one line."""
    first = error.errors(include_url=False)[0]
    where = ".".join(str(part) for part in first["loc"])
    value = repr(first.get("input"))
    found = f", found {value[:80]}" if first["type"] not in ("value_error", "missing") else ""
    message = first["msg"].removeprefix("Value error, ")
    return f"{where + ': ' if where else ''}{message}{found}"
