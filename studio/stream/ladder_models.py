"""Models of version 3: groups with renditions, pages of the index, sound. `docs/STREAM.md` specifies them."""

from __future__ import annotations

import json
import re
from typing import Annotated, Final, Literal

from pydantic import Field, ValidationError, model_validator

from studio.json_types import JsonObject
from studio.stream.manifest_models import (
    MAX_FRAMES,
    MAX_GROUP_FRAMES,
    MAX_GROUPS,
    MAX_SPLATS,
    Box,
    ComponentEntry,
    FileEntry,
    GroupEntry,
    InconsistentError,
    Model,
    MotionGroup,
    PlaneEntry,
    PlanesGroup,
    VideoEntry,
    invalid,
)

FILES: Final = "files"
"""Folder of all files but the manifest."""

NAME_DIGITS: Final = 32
"""Digits of the SHA-256 in a file's name."""

MAX_RENDITIONS = 16
MAX_PAGE_BYTES = 1 << 24
MAX_PAGE_GROUPS = 4096
MAX_AUDIO_BYTES = 1 << 28
MAX_AUDIO_SAMPLES = 1 << 32

AUDIO_TOLERANCE: Final = 0.1
"""Seconds by which sound may be longer than the frames: a few frames of any codec."""

Pruning = Literal["none", "importance", "fine-tuned"]
RenditionId = Annotated[str, Field(pattern=r"^[a-z0-9-]{1,32}$")]
Decibels = Annotated[float, Field(ge=-1000, le=1000, allow_inf_nan=False)]
_PATH = re.compile(rf"{FILES}/([0-9a-f]{{{NAME_DIGITS}}})\.[a-z0-9]{{1,8}}")


def hashed_path(sha256: str, suffix: str) -> str:
    """Path of a file with this SHA-256; `suffix` with its dot."""
    return f"{FILES}/{sha256[:NAME_DIGITS]}{suffix}"


def check_hashed(file: FileEntry) -> None:
    """Raises InconsistentError if the file is not named by its content."""
    found = _PATH.fullmatch(file.path)
    if found is None or found[1] != file.sha256[:NAME_DIGITS]:
        raise InconsistentError("path_not_hash", f"{file.path[:200]!r} is not named by the file's SHA-256")


class LumaCheck(Model):
    """CRC-32 of the decoded luma of one picture of a video, so that players can tell whether their decoder is exact."""

    picture: Annotated[int, Field(ge=0, lt=MAX_GROUP_FRAMES)]
    crc32: Annotated[int, Field(ge=0, lt=1 << 32)]


Checks = Annotated[tuple[LumaCheck, ...], Field(min_length=1, max_length=2)]


class CheckedVideo(VideoEntry):
    """A video with checks of its first and of one later picture."""

    checks: Checks


class CheckedPlane(PlaneEntry):
    """A plane's video with checks of its first and of one later picture."""

    checks: Checks


class CheckedComponent(ComponentEntry):
    """A component whose videos have checks."""

    planes: Annotated[tuple[CheckedPlane, ...], Field(min_length=1, max_length=2)]


def _check_files(group: MotionRendition | PlanesRendition) -> None:
    for file in group.files:
        check_hashed(file)
        if isinstance(file, CheckedVideo | CheckedPlane):
            pictures = [check.picture for check in file.checks]
            if pictures[0] != 0 or sorted(set(pictures)) != pictures or pictures[-1] >= group.frame_count:
                raise InconsistentError("checks", f"checks are of pictures {pictures} of {group.frame_count}")


class MotionRendition(MotionGroup):
    """One rendition of a group of the profile `motion`.

    Attributes:
        id: of the rendition.
        qp: H.264 scale, informative.
        pruning: whether splats were left out, and whether the others were trained further.
        psnr_to_trained: dB; None if not measured.
    """

    id: RenditionId
    qp: Annotated[int, Field(ge=0, le=51)]
    pruning: Pruning
    psnr_to_trained: Decibels | None
    video: CheckedVideo

    @model_validator(mode="after")
    def _check_rendition(self) -> MotionRendition:
        _check_files(self)
        return self


class PlanesRendition(PlanesGroup):
    """One rendition of a group of the profile `planes`; see `MotionRendition`."""

    id: RenditionId
    qp: Annotated[int, Field(ge=0, le=51)]
    pruning: Pruning
    psnr_to_trained: Decibels | None
    components: Annotated[tuple[CheckedComponent, ...], Field(max_length=64)]

    @model_validator(mode="after")
    def _check_rendition(self) -> PlanesRendition:
        _check_files(self)
        return self


Rendition = MotionRendition | PlanesRendition


class GroupLadder(Model):
    """One group in all its renditions, the best first.

    Attributes:
        index: 0-based, consecutive.
        first_frame: index of its first frame in the stream, 0-based.
        frame_count: number of frames, the same in each rendition.
        renditions: complete, independent encodings of the same frames.
    """

    index: Annotated[int, Field(ge=0, lt=MAX_GROUPS)]
    first_frame: Annotated[int, Field(ge=0, lt=MAX_FRAMES)]
    frame_count: Annotated[int, Field(ge=1, le=MAX_GROUP_FRAMES)]
    renditions: tuple[Rendition, ...]

    @model_validator(mode="after")
    def _check(self) -> GroupLadder:
        frames = (self.index, self.first_frame, self.frame_count)
        for one in self.renditions:
            if (one.index, one.first_frame, one.frame_count) != frames:
                raise InconsistentError(
                    "rendition_frames",
                    f"rendition {one.id} of group {self.index} has index {one.index}, {one.frame_count} frames from "
                    f"frame {one.first_frame} on; the group has {self.frame_count} from frame {self.first_frame} on",
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
    def bounding_box(self) -> Box:
        """That of the best rendition."""
        return self.best.bounding_box

    @property
    def splats(self) -> int:
        """Of the best rendition."""
        return self.best.splats

    @property
    def sh_degree(self) -> int:
        """Of the best rendition."""
        return self.best.sh_degree

    @property
    def bytes(self) -> int:
        """Total size of the files of the best rendition."""
        return self.best.bytes

    @property
    def files(self) -> tuple[FileEntry, ...]:
        """Files of all renditions, each once."""
        return tuple({file.path: file for one in self.renditions for file in one.files}.values())

    def to_dict(self) -> JsonObject:
        """JSON-ready values, the inverse of `from_dict`."""
        return self.model_dump(mode="json")

    @staticmethod
    def from_dict(values: JsonObject, name: str = "group entry") -> GroupLadder:
        """Inverse of `to_dict`. Raises StudioError, with `name` as the file, for invalid values."""
        try:
            return _ladder_of(values).model_validate_json(json.dumps(values))
        except ValidationError as error:
            raise invalid(error, name, "Bake the group again.") from None


class MotionLadder(GroupLadder):
    """A group of the profile `motion`."""

    renditions: Annotated[tuple[MotionRendition, ...], Field(min_length=1, max_length=MAX_RENDITIONS)]


class PlanesLadder(GroupLadder):
    """A group of the profile `planes`."""

    renditions: Annotated[tuple[PlanesRendition, ...], Field(min_length=1, max_length=MAX_RENDITIONS)]


def _ladder_of(values: JsonObject) -> type[GroupLadder]:
    first = (values.get("renditions") or [{}])[0]
    return MotionLadder if "channels" in first else PlanesLadder


BakedGroup = GroupEntry | GroupLadder
"""What baking a group gives: its entry in a manifest of version 2 or 3."""


def baked_group(values: JsonObject) -> BakedGroup:
    """From `to_dict` of either. Raises StudioError for invalid values."""
    return GroupLadder.from_dict(values) if "renditions" in values else GroupEntry.from_dict(values)


class RenditionEntry(Model):
    """A rendition over the whole stream.

    Attributes:
        id: in every group.
        qp: highest of its groups, H.264 scale.
        splats: largest number in a group.
        sh_degree: 0 to 3, the same in all groups.
        pruning: whether splats were left out, and whether the others were trained further.
        psnr_to_trained: dB, mean over the measured frames; None if not measured.
        bytes: sum over its groups.
        bandwidth: bits per second at which its group with the highest rate arrives as fast as it plays.
    """

    id: RenditionId
    qp: Annotated[int, Field(ge=0, le=51)]
    splats: Annotated[int, Field(ge=1, le=MAX_SPLATS)]
    sh_degree: Annotated[int, Field(ge=0, le=3)]
    pruning: Pruning
    psnr_to_trained: Decibels | None
    bytes: Annotated[int, Field(ge=1)]
    bandwidth: Annotated[int, Field(ge=1)]


class PageEntry(FileEntry):
    """A page of the index: a file with consecutive groups.

    Attributes:
        frames: frame_count of each of its groups.
    """

    bytes: Annotated[int, Field(ge=1, le=MAX_PAGE_BYTES)]
    frames: Annotated[
        tuple[Annotated[int, Field(ge=1, le=MAX_GROUP_FRAMES)], ...],
        Field(min_length=1, max_length=MAX_PAGE_GROUPS),
    ]

    @model_validator(mode="after")
    def _check_name(self) -> PageEntry:
        check_hashed(self)
        return self


class AudioEntry(FileEntry):
    """The sound.

    Attributes:
        codec: AAC-LC in an MP4 file.
        sample_rate: samples per second and channel.
        channels: 1 or 2.
        samples: per channel, without the encoder's delay and padding.
        start: seconds from the first frame to the first sample.
    """

    bytes: Annotated[int, Field(ge=1, le=MAX_AUDIO_BYTES)]
    codec: Literal["aac"]
    sample_rate: Annotated[int, Field(ge=8000, le=96_000)]
    channels: Annotated[int, Field(ge=1, le=2)]
    samples: Annotated[int, Field(ge=1, le=MAX_AUDIO_SAMPLES)]
    start: Annotated[float, Field(ge=0, le=MAX_FRAMES, allow_inf_nan=False)]

    @property
    def seconds(self) -> float:
        """From the first frame to the end of the sound."""
        return self.start + self.samples / self.sample_rate

    @model_validator(mode="after")
    def _check_name(self) -> AudioEntry:
        check_hashed(self)
        return self
