"""The manifest: everything a player needs to know about a stream, as JSON, validated before any other file is read.

`docs/STREAM.md` specifies it for other players. Unknown keys are ignored, so that later writers can add some; any
change to the meaning of the bytes raises the version.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Final, Literal, Protocol, Self, TypeVar

from pydantic import Field, ValidationError, model_validator

from studio.bounded_text import Bounds, TextError, parse_json
from studio.errors import StudioError
from studio.json_types import JsonObject
from studio.stream.manifest_models import (
    MAX_FRAMES,
    MAX_GROUPS,
    MAX_MANIFEST_BYTES,
    Box,
    GroupEntry,
    InconsistentError,
    Model,
    MotionGroup,
    PlanesGroup,
    Sha256,
    invalid,
)
from studio.stream.source import BAKE_AGAIN

FORMAT: Final = "v3studio-stream"
VERSION: Final = 3
"""Newest version that is read."""

MANIFEST_NAME = "manifest.json"

_BOUNDS = Bounds(size=MAX_MANIFEST_BYTES, values=2_000_000)
"""Ten times what 10,000 frames take in version 2; about 300 MB of memory."""


class Codec(Model):
    """How the videos are encoded."""

    name: Literal["h264", "hevc", "av1"] = "h264"
    pixel_format: Literal["yuv420p"] = "yuv420p"
    color_range: Literal["full"] = "full"


class Manifest(Model):
    """The whole stream.

    Attributes:
        format, version: "v3studio-stream"; 2, or 1 for streams of the profile `planes` written by older versions. 3 for
            one rendition of a stream of version 3, see `studio.stream.ladder_manifest`.
        profile: "planes" or "motion".
        fps: frame rate of playback.
        frame_count: over all groups.
        sh_degree: 0 to 3, the same in all groups.
        scan: pixel of splat i on a plane; "rows": row i // side, column i % side; "morton": the i-th pixel of the
            square in the order of its interleaved column and row bits.
        bounding_box: over all groups.
        groups: in order, without gaps, from frame 0.
        settings: bake settings, informative.
        metadata: free-form; "suggested_camera", if present, is a camera as in rig.json.
        total_bytes: size of all files of the stream, including the manifest.
        manifest_sha256: SHA-256 of the manifest's bytes with these 64 digits replaced by zeros.
    """

    format: Literal["v3studio-stream"] = FORMAT
    version: Literal[1, 2, 3] = 2
    profile: str = ""
    fps: Annotated[float, Field(gt=0, le=1000, allow_inf_nan=False)]
    frame_count: Annotated[int, Field(ge=1, le=MAX_FRAMES)]
    sh_degree: Annotated[int, Field(ge=0, le=3)]
    scan: str = ""
    codec: Codec = Codec()
    bounding_box: Box
    groups: Sequence[GroupEntry]
    settings: JsonObject = Field(default_factory=dict)
    metadata: JsonObject = Field(default_factory=dict)
    total_bytes: Annotated[int, Field(ge=1)]
    manifest_sha256: Sha256

    @model_validator(mode="after")
    def _check(self) -> Manifest:
        frame = 0
        paths: set[str] = set()
        for number, group in enumerate(self.groups):
            if group.index != number or group.first_frame != frame:
                raise InconsistentError(
                    "group_order",
                    f"group {number} has index {group.index} and starts at frame {group.first_frame}; expected index "
                    f"{number} and frame {frame}",
                )
            if group.sh_degree != self.sh_degree:
                raise InconsistentError(
                    "sh_degree", f"group {number} has SH degree {group.sh_degree}, the stream has {self.sh_degree}"
                )
            frame = group.end_frame
            for file in group.files:
                if file.path in paths or file.path == MANIFEST_NAME:
                    raise InconsistentError("duplicate_path", f"path {file.path!r} is used twice")
                paths.add(file.path)
        if frame != self.frame_count:
            raise InconsistentError("frame_count", f"frame_count is {self.frame_count}, the groups have {frame} frames")
        return self

    def group_of(self, frame: int) -> GroupEntry:
        """The group that contains a frame. Raises StudioError unless 0 <= frame < frame_count."""
        if not 0 <= frame < self.frame_count:
            raise no_such_frame(frame, self.frame_count)
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
    def played_bytes(self) -> int:
        """Bytes that playing all of it takes: all files; in version 3, those of the chosen rendition."""
        return self.total_bytes

    @property
    def bytes_per_frame(self) -> float:
        """Bytes that playing takes, divided by the number of frames."""
        return self.played_bytes / self.frame_count

    def to_bytes(self) -> bytes:
        """Content of the manifest file. Size and checksum must be filled in already, see `seal`."""
        return (json.dumps(self.model_dump(mode="json"), indent=1, allow_nan=False) + "\n").encode()


class PlanesManifest(Manifest):
    """A stream of the profile `planes`."""

    version: Literal[1, 2] = 2
    profile: Literal["planes"] = "planes"
    scan: Literal["rows"] = "rows"
    groups: Annotated[tuple[PlanesGroup, ...], Field(min_length=1, max_length=MAX_GROUPS)]

    @model_validator(mode="after")
    def _check_codec(self) -> PlanesManifest:
        check_planes_codec(self.codec)
        return self


class MotionManifest(Manifest):
    """A stream of the profile `motion`."""

    version: Literal[2] = 2
    profile: Literal["motion"] = "motion"
    scan: Literal["morton"] = "morton"
    groups: Annotated[tuple[MotionGroup, ...], Field(min_length=1, max_length=MAX_GROUPS)]


PROFILES: Final[dict[str, type[Manifest]]] = {"planes": PlanesManifest, "motion": MotionManifest}


def no_such_frame(frame: int, frame_count: int) -> StudioError:
    """The error for a frame number outside 0 to frame_count - 1."""
    return StudioError(
        "stream.no_such_frame",
        f"no frame {frame}; the stream has frames 0 to {frame_count - 1}",
        value=frame,
        frame_count=frame_count,
    )


def seal(manifest: Manifest) -> tuple[Manifest, bytes]:
    """`seal_with` of a manifest that lists all files."""
    return seal_with(manifest, sum(group.bytes for group in manifest.groups))


class _Sealable(Protocol):
    def model_copy(self, *, update: Mapping[str, Any]) -> Self: ...

    def to_bytes(self) -> bytes: ...


_AnyManifest = TypeVar("_AnyManifest", bound=_Sealable)


def seal_with(manifest: _AnyManifest, file_bytes: int) -> tuple[_AnyManifest, bytes]:
    """Fill in `total_bytes` and `manifest_sha256`, which depend on the bytes of the manifest itself.

    Args:
        manifest: a draft.
        file_bytes: of all other files of the stream.

    Returns:
        The manifest and the bytes to write.
    """
    zeros = "0" * 64
    total = file_bytes
    while True:  # the size includes its own digits; it only grows, so this converges after a few rounds
        draft = manifest.model_copy(update={"total_bytes": total, "manifest_sha256": zeros})
        data = draft.to_bytes()
        if file_bytes + len(data) == total:
            break
        total = file_bytes + len(data)
    digest = hashlib.sha256(data).hexdigest()
    sealed = draft.model_copy(update={"manifest_sha256": digest})
    return sealed, data.replace(zeros.encode(), digest.encode(), 1)


def parse_head(data: bytes, name: str) -> JsonObject:
    """The values of a manifest of any version that this program reads, not validated further.

    Raises:
        StudioError: not JSON, another format, or a newer version.
    """
    try:
        head = parse_json(data, _BOUNDS)
    except TextError as error:
        raise StudioError("manifest.not_json", f"not valid JSON ({error})", file=name, fix=BAKE_AGAIN) from None
    if not isinstance(head, dict) or head.get("format") != FORMAT:
        raise StudioError(
            "manifest.wrong_format",
            f"not the manifest of a {FORMAT}",
            file=name,
            fix="Choose the folder of a baked stream.",
        )
    version = head.get("version")
    if isinstance(version, int) and not isinstance(version, bool) and version > VERSION:
        raise StudioError(
            "manifest.newer_version",
            f"the stream has format version {version}; this program reads versions up to {VERSION}",
            file=name,
            value=version,
            fix="Update V3 Studio.",
            expected=VERSION,
        )
    return head


def unknown_profile(head: JsonObject, name: str) -> StudioError:
    """The error for a profile that does not exist."""
    profile = str(head.get("profile"))[:80]
    return StudioError(
        "manifest.unknown_profile",
        f"unknown profile {profile!r}; expected one of {', '.join(PROFILES)}",
        file=name,
        value=profile,
        fix=BAKE_AGAIN,
    )


def check_planes_codec(codec: Codec) -> None:
    """Raises InconsistentError unless the codec is one that the profile `planes` has."""
    if codec.name != "h264":
        raise InconsistentError("codec", f"profile planes requires codec h264, not {codec.name}")


def check_digest(data: bytes, digest: str, name: str) -> None:
    """Raises StudioError if `digest` is not the SHA-256 of the manifest with its digits replaced by zeros."""
    blanked = data.replace(digest.encode(), b"0" * 64)
    if hashlib.sha256(blanked).hexdigest() != digest:
        raise StudioError(
            "manifest.wrong_checksum",
            "the file does not match its own SHA-256: it was damaged or edited",
            file=name,
            fix=BAKE_AGAIN,
        )


def wrong_total(found: int, expected: int, name: str) -> StudioError:
    """The error for `total_bytes` that are not those of the files."""
    return StudioError(
        "manifest.wrong_total",
        f"total_bytes is {found}, but the listed files have {expected} bytes",
        file=name,
        value=found,
        fix=BAKE_AGAIN,
        expected=expected,
    )


def parse_manifest(data: bytes, name: str) -> Manifest:
    """Parse and validate a manifest of version 1 or 2.

    Args:
        data: content of the file.
        name: path or URL for messages.

    Raises:
        StudioError: not JSON, another format, a newer version, a value out of bounds, a path out of the folder, or a
            checksum mismatch.
    """
    head = parse_head(data, name)
    kind = PROFILES.get(head["profile"]) if isinstance(head.get("profile"), str) else None
    if kind is None:
        raise unknown_profile(head, name)
    try:
        manifest = kind.model_validate_json(data)
    except ValidationError as error:
        raise invalid(error, name, BAKE_AGAIN) from None
    check_digest(data, manifest.manifest_sha256, name)
    expected = sum(group.bytes for group in manifest.groups) + len(data)
    if manifest.total_bytes != expected:
        raise wrong_total(manifest.total_bytes, expected, name)
    return manifest
