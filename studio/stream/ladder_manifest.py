"""The manifest of version 3: groups in several renditions, with an index in pages. `docs/STREAM.md` specifies it."""

from __future__ import annotations

import hashlib
import json
from bisect import bisect_right
from collections.abc import Sequence
from itertools import accumulate
from typing import Annotated, Any, Final, Literal

from pydantic import Field, ValidationError, field_validator, model_validator

from studio.counts import counted
from studio.errors import StudioError
from studio.json_types import JsonObject
from studio.stream.ladder_models import (
    AUDIO_TOLERANCE,
    MAX_RENDITIONS,
    AudioEntry,
    FileEntry,
    GroupLadder,
    MotionLadder,
    PageEntry,
    PlanesLadder,
    RenditionEntry,
)
from studio.stream.manifest import (
    FORMAT,
    Codec,
    Manifest,
    check_digest,
    check_planes_codec,
    no_such_frame,
    parse_head,
    seal_with,
    unknown_profile,
    wrong_total,
)
from studio.stream.manifest_models import (
    MAX_FRAMES,
    MAX_GROUPS,
    Box,
    GroupEntry,
    InconsistentError,
    Model,
    Sha256,
    invalid,
)
from studio.stream.source import BAKE_AGAIN

PAGE_FORMAT: Final = "v3studio-stream-page"
MAX_FREE_BYTES = 1 << 20
MAX_FREE_DEPTH = 16


class LadderManifest(Model):
    """The manifest as stored.

    Attributes:
        fps: frame rate of playback.
        frame_count: over all groups.
        live: groups are still being added.
        renditions: the best first; every group has them all.
        groups: the first groups, from frame 0.
        pages: where the other groups are.
        audio: the sound; None for a silent stream.
        settings, metadata: free-form, at most 16 levels deep and 1 MiB.
        total_bytes: size of all files of the stream, each once, including the manifest.
        manifest_sha256: SHA-256 of the manifest's bytes with these 64 digits replaced by zeros.
    """

    format: Literal["v3studio-stream"] = FORMAT
    version: Literal[3] = 3
    profile: str = ""
    fps: Annotated[float, Field(gt=0, le=1000, allow_inf_nan=False)]
    frame_count: Annotated[int, Field(ge=1, le=MAX_FRAMES)]
    scan: str = ""
    codec: Codec = Codec()
    bounding_box: Box
    live: bool = False
    renditions: Annotated[tuple[RenditionEntry, ...], Field(min_length=1, max_length=MAX_RENDITIONS)]
    groups: Sequence[GroupLadder]
    pages: Annotated[tuple[PageEntry, ...], Field(max_length=MAX_GROUPS)] = ()
    audio: AudioEntry | None = None
    settings: JsonObject = Field(default_factory=dict)
    metadata: JsonObject = Field(default_factory=dict)
    total_bytes: Annotated[int, Field(ge=1)]
    manifest_sha256: Sha256

    @field_validator("settings", "metadata")
    @classmethod
    def _bounded(cls, value: JsonObject) -> JsonObject:
        check_free(value)
        return value

    @model_validator(mode="after")
    def _check(self) -> LadderManifest:
        ids = [one.id for one in self.renditions]
        if len(set(ids)) < len(ids):
            raise InconsistentError("rendition_ids", "two renditions have the same id")
        frame = 0
        for number, group in enumerate(self.groups):
            check_ladder(group, number, frame, self.renditions)
            frame = group.end_frame
        counts = self.frame_counts
        if len(counts) > MAX_GROUPS:
            raise InconsistentError("group_count", f"{counted(len(counts), 'group')}; the maximum is {MAX_GROUPS}")
        if sum(counts) != self.frame_count:
            raise InconsistentError(
                "frame_count", f"frame_count is {self.frame_count}, the groups have {sum(counts)} frames"
            )
        seconds = self.frame_count / self.fps
        if self.audio is not None and self.audio.seconds > seconds + AUDIO_TOLERANCE:
            raise InconsistentError(
                "audio_length",
                f"the sound ends at {self.audio.seconds:.3f} s, the frames at {seconds:.3f} s",
            )
        return self

    @property
    def frame_counts(self) -> tuple[int, ...]:
        """Frames of each group of the stream, also of those in pages."""
        return (
            *(group.frame_count for group in self.groups),
            *(count for page in self.pages for count in page.frames),
        )

    def to_bytes(self) -> bytes:
        """Content of the manifest file. Size and checksum must be filled in already, see `seal_ladder`."""
        return compact(self.model_dump(mode="json"))


class PlanesLadderManifest(LadderManifest):
    """A stream of the profile `planes`."""

    profile: Literal["planes"] = "planes"
    scan: Literal["rows"] = "rows"
    groups: Annotated[tuple[PlanesLadder, ...], Field(min_length=1, max_length=MAX_GROUPS)]

    @model_validator(mode="after")
    def _check_codec(self) -> PlanesLadderManifest:
        check_planes_codec(self.codec)
        return self


class MotionLadderManifest(LadderManifest):
    """A stream of the profile `motion`."""

    profile: Literal["motion"] = "motion"
    scan: Literal["morton"] = "morton"
    groups: Annotated[tuple[MotionLadder, ...], Field(min_length=1, max_length=MAX_GROUPS)]


class Page(Model):
    """A page of the index as stored."""

    format: Literal["v3studio-stream-page"] = PAGE_FORMAT
    groups: Sequence[GroupLadder]

    def to_bytes(self) -> bytes:
        """Content of the page's file."""
        return compact(self.model_dump(mode="json"))


class PlanesPage(Page):
    """A page of a stream of the profile `planes`."""

    groups: Annotated[tuple[PlanesLadder, ...], Field(min_length=1)]


class MotionPage(Page):
    """A page of a stream of the profile `motion`."""

    groups: Annotated[tuple[MotionLadder, ...], Field(min_length=1)]


LADDER_PROFILES: Final[dict[str, type[LadderManifest]]] = {
    "planes": PlanesLadderManifest,
    "motion": MotionLadderManifest,
}
PAGES: Final[dict[str, type[Page]]] = {"planes": PlanesPage, "motion": MotionPage}


class RenditionManifest(Manifest):
    """One rendition of a stream of version 3, with the attributes of a manifest of version 2.

    Its groups are a sequence that reads pages of the index when they are needed.

    Attributes:
        rendition: its id.
        own_bytes: of its files, the pages and the manifest.
        starts: first frame of each group.
    """

    rendition: str
    own_bytes: int
    starts: tuple[int, ...]

    @property
    def played_bytes(self) -> int:
        """See `Manifest.played_bytes`."""
        return self.own_bytes

    def group_of(self, frame: int) -> GroupEntry:
        """See `Manifest.group_of`; reads the page of that group alone."""
        if not 0 <= frame < self.frame_count:
            raise no_such_frame(frame, self.frame_count)
        return self.groups[bisect_right(self.starts, frame) - 1]


def compact(values: Any) -> bytes:
    """JSON without spaces, with a final newline."""
    return (json.dumps(values, separators=(",", ":"), allow_nan=False) + "\n").encode()


def check_free(value: Any) -> None:
    """Raises InconsistentError for a free-form value that is nested too deeply or too large."""
    level, depth = [value], 0
    while level:
        if depth > MAX_FREE_DEPTH:
            raise InconsistentError("free_form", f"nested more than {MAX_FREE_DEPTH} levels deep")
        nested = (one.values() if isinstance(one, dict) else one for one in level if isinstance(one, dict | list))
        level, depth = [item for items in nested for item in items], depth + 1
    if len(compact(value)) > MAX_FREE_BYTES:
        raise InconsistentError("free_form", f"more than {MAX_FREE_BYTES} bytes")


def check_ladder(group: GroupLadder, number: int, frame: int, renditions: Sequence[RenditionEntry]) -> None:
    """Raises InconsistentError unless this is group `number`, starts at `frame` and has the stream's renditions."""
    if group.index != number or group.first_frame != frame:
        raise InconsistentError(
            "group_order",
            f"group {number} has index {group.index} and starts at frame {group.first_frame}; expected index {number} "
            f"and frame {frame}",
        )
    if [one.id for one in group.renditions] != [one.id for one in renditions]:
        raise InconsistentError("rendition_ids", f"group {number} does not have the stream's renditions")
    for one, stream in zip(group.renditions, renditions, strict=True):
        if one.sh_degree != stream.sh_degree:
            raise InconsistentError(
                "sh_degree",
                f"rendition {one.id} of group {number} has SH degree {one.sh_degree}; expected {stream.sh_degree}",
            )
        if one.splats > stream.splats:
            raise InconsistentError(
                "rendition_splats",
                f"group {number} has {one.splats} splats in rendition {one.id}, which has at most {stream.splats}",
            )


def distinct_bytes(groups: Sequence[GroupLadder]) -> int:
    """Total size of the files of all renditions, each counted once."""
    return sum({file.path: file.bytes for group in groups for file in group.files}.values())


def fixed_files(manifest: LadderManifest) -> tuple[FileEntry, ...]:
    """Pages and sound."""
    return (*manifest.pages, *((manifest.audio,) if manifest.audio is not None else ()))


def seal_ladder(manifest: LadderManifest, group_bytes: int) -> tuple[LadderManifest, bytes]:
    """`seal_with`; `group_bytes` is `distinct_bytes` of all groups, also of those in pages."""
    return seal_with(manifest, group_bytes + sum(file.bytes for file in fixed_files(manifest)))


def parse_ladder(data: bytes, name: str) -> LadderManifest:
    """Parse and validate a manifest of version 3.

    Args:
        data: content of the file.
        name: path or URL for messages.

    Raises:
        StudioError: not JSON, another format or version, a value out of bounds, or a checksum mismatch.
    """
    head = parse_head(data, name)
    kind = LADDER_PROFILES.get(head["profile"]) if isinstance(head.get("profile"), str) else None
    if kind is None:
        raise unknown_profile(head, name)
    try:
        manifest = kind.model_validate_json(data)
    except ValidationError as error:
        raise invalid(error, name, BAKE_AGAIN) from None
    check_digest(data, manifest.manifest_sha256, name)
    if not manifest.pages:
        expected = distinct_bytes(manifest.groups) + sum(file.bytes for file in fixed_files(manifest)) + len(data)
        if manifest.total_bytes != expected:
            raise wrong_total(manifest.total_bytes, expected, name)
    return manifest


def parse_page(
    data: bytes, page: PageEntry, manifest: LadderManifest, first_group: int, first_frame: int, name: str
) -> tuple[GroupLadder, ...]:
    """Parse and validate a page of the index.

    Args:
        data: content of its file.
        page: its entry in the manifest.
        manifest: the stream's.
        first_group, first_frame: of the page, by the manifest.
        name: path or URL for messages.

    Raises:
        StudioError: another checksum, not JSON, a value out of bounds, or other groups than the manifest promises.
    """
    if hashlib.sha256(data).hexdigest() != page.sha256:
        raise StudioError("stream.wrong_checksum", "SHA-256 differs from the manifest", file=name, fix=BAKE_AGAIN)
    try:
        groups = PAGES[manifest.profile].model_validate_json(data).groups
        found = tuple(group.frame_count for group in groups)
        frame = first_frame
        for number, group in enumerate(groups, first_group):
            check_ladder(group, number, frame, manifest.renditions)
            frame = group.end_frame
        if found != page.frames:
            raise InconsistentError(
                "page_frames", "the page's groups do not have the frames that the manifest promises"
            )
    except ValidationError as error:
        raise invalid(error, name, BAKE_AGAIN) from None
    except InconsistentError as error:
        raise StudioError(
            "manifest.invalid", str(error), file=name, fix=BAKE_AGAIN, location="", rule=error.rule
        ) from None
    return tuple(groups)


def starts_of(manifest: LadderManifest) -> tuple[int, ...]:
    """First frame of each group."""
    return tuple(accumulate(manifest.frame_counts[:-1], initial=0))


def check_growth(old: LadderManifest, new: LadderManifest, name: str) -> None:
    """Raises StudioError unless a live stream's new manifest only adds groups to the old one."""
    kept = old.frame_counts
    fixed = ("profile", "fps", "scan", "codec")
    changed = [key for key in fixed if getattr(old, key) != getattr(new, key)]
    if [one.id for one in old.renditions] != [one.id for one in new.renditions]:
        changed.append("renditions")
    same = all(before.files == after.files for before, after in zip(old.groups, new.groups, strict=False))
    if new.frame_counts[: len(kept)] != kept or ("renditions" not in changed and not same):
        changed.append("groups")
    if changed:
        raise StudioError(
            "stream.live_changed",
            f"the live stream was replaced by another one ({', '.join(changed)} differ)",
            file=name,
            value=changed,
            fix="Open the stream again.",
        )
