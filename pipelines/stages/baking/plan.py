"""Plans a bake: which groups the stream has, what each is made from, and which are baked already."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from v3studio.pipelines.stages import stage_named
from v3studio.pipelines.stages.baking.rungs import RungTraining, finetuned_rungs
from v3studio.pipelines.stages.inputs import Inputs
from v3studio.pipelines.stages.params import key_of, settings_affecting
from v3studio.pipelines.takes.authored.edits import edit_params, no_frames_left
from v3studio.pipelines.takes.files.digests import digest_of_file
from v3studio.pipelines.takes.files.json_files import read_model
from v3studio.pipelines.takes.frames.edited import EditedGroup, edits_of_group
from v3studio.pipelines.takes.frames.frame_numbers import FrameNumbers
from v3studio.pipelines.takes.frames.groups import Group
from v3studio.pipelines.takes.results.stage_files import BakedGroupNote
from v3studio.pipelines.takes.take import group_name
from v3studio.studio.cameras import Camera
from v3studio.studio.edits.edit_list import Trim
from v3studio.studio.stream.attributes import VERSION

if TYPE_CHECKING:
    from v3studio.studio.stream import Rendition

STAGE = stage_named("bake")


@dataclass(frozen=True)
class Part:
    """A group of the stream: a trained group, or a part of one (`bake.first_group_size`, or the take is trimmed).
    `index` counts groups in the stream, `indices` frames in the take, `stream_first` frames in the stream, from 0."""

    index: int
    trained: Group
    indices: range
    stream_first: int

    @property
    def first(self) -> int:
        """Its first frame."""
        return self.indices[0]


def parts_of(groups: Sequence[Group], first_size: int | None, trim: Trim | None = None) -> tuple[Part, ...]:
    """The stream's groups: those of the take within its trim, the first one cut after `first_size` frames if longer."""
    kept = range(groups[-1].indices[-1] + 1)
    if trim is not None:
        kept = FrameNumbers.of(groups).within(trim.first, trim.last)
    start, stop = kept.start, kept.stop
    within = [(group, range(max(group.first, start), min(group.indices[-1] + 1, stop))) for group in groups]
    ranges = [(group, indices) for group, indices in within if indices]
    if first_size is not None and ranges and len(ranges[0][1]) > first_size:
        group, whole = ranges[0]
        ranges[:1] = [(group, whole[:first_size]), (group, whole[first_size:])]
    return tuple(Part(index, group, indices, indices[0] - start) for index, (group, indices) in enumerate(ranges))


def planned_parts(inputs: Inputs) -> tuple[Part, ...]:
    """The groups of a take's stream, in order. Raises StudioError: `edits.no_frames_left`, or bad edits."""
    trim = inputs.edits.trim
    parts = parts_of(inputs.groups, inputs.config.bake.first_group_size, trim)
    if not parts and trim is not None:
        raise no_frames_left(inputs.take, trim, inputs.raw_footage.frames)
    return parts


def baked_frames(inputs: Inputs) -> range:
    """The frames of the stream, counted from 0 in the take. Raises StudioError as `planned_parts`."""
    parts = planned_parts(inputs)
    return range(parts[0].first, parts[-1].indices[-1] + 1)


def group_to_bake(inputs: Inputs, part: Part) -> EditedGroup:
    """The trained group of a part, as it is baked."""
    return EditedGroup(inputs.take, part.trained, inputs.edits)


def stream_cameras(inputs: Inputs) -> list[Camera]:
    """The training cameras in the world of the stream."""
    footage, world = inputs.trained_footage, inputs.edits.similarity
    cameras = [footage.rig[name] for name in footage.train_cameras]
    return cameras if world.is_identity else [world.camera(camera) for camera in cameras]


class BakePlan:
    """The parts of a stream, in order, and the work folder in which they are baked. Each baked part has a note beside
    the folder: the digest of everything that it was made from, the digests of its files, and its entry for the
    manifest. Files are in the work folder or in the take's stream."""

    def __init__(self, inputs: Inputs) -> None:
        self.inputs = inputs
        self.parts = planned_parts(inputs)
        self.folder = inputs.take.work("bake") / "stream"
        self.training = RungTraining(inputs)

    @cached_property
    def baked_set(self) -> tuple[Rendition, ...]:
        """The parts of the take's set, baked into the work folder; empty if there is no set. Raises StudioError."""
        from v3studio.studio.stream import bake_set

        splats = self.inputs.scene
        return () if splats is None else bake_set(splats, self.folder, self.inputs.config.bake)

    def of_group(self, group: Group) -> list[Part]:
        """The parts of a trained group."""
        return [part for part in self.parts if part.trained.index == group.index]

    def note_path(self, part: Part) -> Path:
        """File with the note on a baked part."""
        return self.inputs.take.work("bake") / f"{group_name(part.index)}.json"

    def baked(self, part: Part, known: Mapping[Path, str] | None = None) -> BakedGroupNote | None:
        """The note on a part that is baked and undamaged, else None. `known`: digests of files that need no reading."""
        if not self.note_path(part).is_file():
            return None
        note = read_model(self.note_path(part), BakedGroupNote)
        if note.key != self.key(part, known):
            return None
        return note if all(self.file(path, note, known) is not None for path in note.files) else None

    def file(self, path: str, note: BakedGroupNote, known: Mapping[Path, str] | None = None) -> Path | None:
        """An undamaged file of a baked part, in the work folder or in the stream; `known` as for `baked`."""
        for folder in (self.folder, self.inputs.take.stream):
            file = folder / path
            digest = (known or {}).get(file) or (digest_of_file(file) if file.is_file() else None)
            if digest is not None and digest == note.digests.get(path):
                return file
        return None

    def key(self, part: Part, known: Mapping[Path, str] | None = None) -> str:
        """Digest of everything that a part is made from; `known` as for `baked`."""
        inputs, trained = self.inputs, part.trained
        edits = edits_of_group(inputs.edits, trained)
        indices = (*part.indices, *(trained.indices if edits.removes else ()))
        frames = [inputs.take.finished_frame(trained.index, index) for index in indices]
        content = [(known or {}).get(path) or (digest_of_file(path) if path.is_file() else None) for path in frames]
        edited = edit_params(edits)
        if part.stream_first != part.first:
            edited["first frame in the stream"] = part.stream_first
        settings = settings_affecting(inputs.config, "videos")
        settings["frames a second"] = float(inputs.raw_footage.fps)  # the level of the video depends on it
        finetuned = [self.training.key(trained, rung) for rung in finetuned_rungs(inputs.config)]
        more = [one for one in (finetuned, edited) if one]
        return key_of(STAGE.name, STAGE.version, VERSION, settings, part.index, part.first, content, *more)
