"""The manifest: everything a player must know of a stream, as JSON, checked before anything else is read.

`docs/STREAM.md` describes it for writers of other players. Keys that this version does not know are ignored, so that
later writers may add some; whatever changes the meaning of the bytes raises the version.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from typing import Annotated, Any, Final, Literal

from pydantic import Field, TypeAdapter, ValidationError, model_validator

from studio.errors import StudioError
from studio.stream.manifest_models import (
    MAX_FRAMES,
    MAX_GROUPS,
    Box,
    GroupEntry,
    Model,
    MotionGroup,
    PlanesGroup,
    Sha256,
    sentence,
)

FORMAT: Final = "v3studio-stream"
VERSION: Final = 2
MANIFEST_NAME = "manifest.json"


class Codec(Model):
    """How the videos are encoded."""

    name: Literal["h264", "hevc", "av1"] = "h264"
    pixel_format: Literal["yuv420p"] = "yuv420p"
    color_range: Literal["full"] = "full"


class Manifest(Model):
    """The whole stream.

    Attributes:
        format, version: "v3studio-stream"; 2, or 1 for streams of the profile `planes` that older programs wrote.
        profile: "planes" or "motion".
        fps: frames a second to play at.
        frame_count: over all groups.
        sh_degree: 0 to 3, the same in all groups.
        scan: how splat i lies on a plane; "rows": at row i // side, column i % side; "morton": at the pixel whose
            column and row, their bits interleaved, come i-th within the square.
        bounding_box: over all groups.
        groups: in order, without gaps, from frame 0.
        settings: what it was baked with. For information.
        metadata: free; "suggested_camera" holds a camera as in rig.json where there is one.
        total_bytes: all files of the stream, this one included.
        manifest_sha256: of this file's bytes with these 64 digits replaced by zeros.
    """

    format: Literal["v3studio-stream"] = FORMAT
    version: Literal[1, 2] = VERSION
    profile: str = ""
    fps: Annotated[float, Field(gt=0, le=1000, allow_inf_nan=False)]
    frame_count: Annotated[int, Field(ge=1, le=MAX_FRAMES)]
    sh_degree: Annotated[int, Field(ge=0, le=3)]
    scan: str = ""
    codec: Codec = Codec()
    bounding_box: Box
    groups: Sequence[GroupEntry]
    settings: dict[str, Any] = Field(default_factory=dict)
    metadata: dict[str, Any] = Field(default_factory=dict)
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
            for file in group.files:
                if file.path in paths or file.path == MANIFEST_NAME:
                    raise ValueError(f"path {file.path!r} is used twice")
                paths.add(file.path)
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


class PlanesManifest(Manifest):
    """A stream of the profile `planes`."""

    profile: Literal["planes"] = "planes"
    scan: Literal["rows"] = "rows"
    groups: Annotated[tuple[PlanesGroup, ...], Field(min_length=1, max_length=MAX_GROUPS)]

    @model_validator(mode="after")
    def _check_codec(self) -> PlanesManifest:
        if self.codec.name != "h264":
            raise ValueError(f"the profile planes is encoded as h264, not {self.codec.name}")
        return self


class MotionManifest(Manifest):
    """A stream of the profile `motion`."""

    version: Literal[2] = VERSION
    profile: Literal["motion"] = "motion"
    scan: Literal["morton"] = "morton"
    groups: Annotated[tuple[MotionGroup, ...], Field(min_length=1, max_length=MAX_GROUPS)]


PROFILES: Final[dict[str, type[Manifest]]] = {"planes": PlanesManifest, "motion": MotionManifest}


def manifest_schema() -> dict[str, Any]:
    """JSON schema (2020-12) of the manifest, what `docs/stream.schema.json` holds. Bounds that tie values together
    (sums, counts, order) cannot be said in it; `docs/STREAM.md` does."""
    kinds = TypeAdapter(PlanesManifest | MotionManifest)
    schema = kinds.json_schema()
    schema["$schema"] = "https://json-schema.org/draft/2020-12/schema"
    schema["title"] = "Manifest of a v3studio-stream"
    return schema


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
    kind = PROFILES.get(head["profile"]) if isinstance(head.get("profile"), str) else None
    if kind is None:
        raise StudioError(
            f"{name}: the profile is {str(head.get('profile'))[:80]!r}; it must be one of {', '.join(PROFILES)}."
        )
    try:
        manifest = kind.model_validate_json(data)
    except ValidationError as error:
        raise StudioError(f"{name}: {sentence(error)}; bake or fetch the stream again.") from None
    digest = manifest.manifest_sha256
    blanked = data.replace(digest.encode(), b"0" * 64)
    if hashlib.sha256(blanked).hexdigest() != digest:
        raise StudioError(f"{name}: the bytes do not fit their own SHA-256, so the file was damaged or edited.")
    expected = sum(group.bytes for group in manifest.groups) + len(data)
    if manifest.total_bytes != expected:
        raise StudioError(f"{name}: total_bytes is {manifest.total_bytes}, the stream's files have {expected}.")
    return manifest
