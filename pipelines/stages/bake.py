"""Bakes trained groups to a stream. In version 2 its folder is replaced as a whole; in version 3 its manifest is."""

from __future__ import annotations

import os
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pipelines.reports.pictures import draw
from pipelines.stages.base import Context, StageReporter
from pipelines.stages.contribution import DrawnContribution
from pipelines.stages.filmed_error import FilmedError
from pipelines.stages.params import Params, key_of, settings_affecting
from pipelines.stages.rungs import FinetunedFrames, RungTraining, finetuned_rungs, finetuning_params
from pipelines.stages.summaries import BakeSummary
from pipelines.takes.atomic_files import atomic_path, digest_of_file, link_or_copy, read_model, remove, write_model
from pipelines.takes.edit_params import edit_params
from pipelines.takes.edited import EditedFrames, EditedGroup, edits_of_group
from pipelines.takes.groups import Group
from pipelines.takes.records import digests_on_record, result_of
from pipelines.takes.stage_files import BakedGroupNote
from pipelines.takes.take import group_name
from studio.atomic_files import exchange, sync
from studio.capture.digest import digest_files
from studio.counts import counted
from studio.edits.edit_list import UP, Trim
from studio.errors import Message, StudioError

if TYPE_CHECKING:
    from studio.cameras import Camera
    from studio.gaussians import Gaussians
    from studio.stream import AudioEntry, BakedGroup, BakeSettings, StreamMetadata


SHORT_SOUND = 0.05
"""Seconds of silence at an end of the sound that a warning tells of."""


@dataclass(frozen=True)
class Part:
    """A group of the stream: a trained group, or a part of one (`bake.first_group_size`, or the take is trimmed).

    Attributes:
        index: number of the group in the stream.
        trained: the trained group.
        indices: its frames, counted from 0 in the take.
        stream_first: its first frame, counted from 0 in the stream.
    """

    index: int
    trained: Group
    indices: range
    stream_first: int

    @property
    def first(self) -> int:
        """Its first frame."""
        return self.indices[0]


def parts_of(groups: Sequence[Group], first_size: int | None, trim: Trim | None = None) -> tuple[Part, ...]:
    """The stream's groups: those of the take within its trim, the first one cut after `first_size` frames if it is
    longer."""
    start, stop = (trim.first, trim.last + 1) if trim is not None else (0, groups[-1].indices[-1] + 1)
    kept = [(group, range(max(group.first, start), min(group.indices[-1] + 1, stop))) for group in groups]
    ranges = [(group, indices) for group, indices in kept if indices]
    if first_size is not None and ranges and len(ranges[0][1]) > first_size:
        group, whole = ranges[0]
        ranges[:1] = [(group, whole[:first_size]), (group, whole[first_size:])]
    return tuple(Part(index, group, indices, indices[0] - start) for index, (group, indices) in enumerate(ranges))


class BakeStage:
    """The stage `bake`; its units are groups.

    Groups are baked into a work folder, each with a file that records what it was made from. When all are finished, the
    manifest is written and the folder replaces the old stream, or, in version 3, the old stream gets the new files
    and then the new manifest. Valid groups of the old stream are reused.

    Rungs of the ladder that keep only a share of the splats are fine-tuned first; see `pipelines.stages.rungs`.
    """

    name = "bake"
    title = "Baking"
    version = 2
    weight = 3.0
    dependencies: tuple[str, ...] = ("train",)

    def params(self, context: Context) -> Params:
        """Encoding settings, and the contents of the manifest."""
        return {
            **(finetuning_params(context) if finetuned_rungs(context) else {}),
            **_compared_footage(context),
            **settings_affecting(context.config, "videos", "manifest", "sound"),
            "frames a second": float(context.footage.raw.fps),
            **_content_of_sound(context),
            **edit_params(context.edits),
        }

    def results(self, context: Context) -> list[Path]:
        """All files of the stream."""
        return sorted(path for path in context.take.stream.rglob("*") if path.is_file())

    def units(self, context: Context) -> tuple[int, int, str] | None:
        """Groups that are baked with current settings and inputs."""
        groups = self.parts(context)
        known = digests_on_record(context.take, "train") | digests_on_record(context.take, self.name)
        return sum(self._seems_done(context, group, known) for group in groups), len(groups), "groups"

    def run(self, context: Context, reporter: StageReporter) -> BakeSummary:
        """Bake the groups that are missing, then replace the stream."""
        from studio.stream import baked_group, write_manifest

        groups = self.parts(context)
        if context.executor is not None:
            todo = [group for group in context.groups if not self.group_done(context, group)]
            if todo:
                context.executor.run(self, context, todo, reporter)
        new = self._folder(context)
        new.mkdir(parents=True, exist_ok=True)
        settings = context.config.bake
        entries: list[BakedGroup] = []
        for position, group in enumerate(groups):
            start, stop = position / len(groups), (position + 1) / len(groups)
            place = self._place(context, group)
            if place is None:
                self._bake_once(context, group, reporter, start, stop)
            elif settings.stream_version == 3:
                self._link(context, group, new)
            elif place != new / group_name(group.index):
                remove(new / group_name(group.index))
                shutil.copytree(place, new / group_name(group.index), copy_function=link_or_copy)
            entries.append(baked_group(read_model(self._note(context, group), BakedGroupNote).entry))
            self._warn_of_limits(context, entries[-1], reporter)
            reporter.metrics(
                {"splats": entries[-1].splats, "bytes": entries[-1].bytes, "frames": entries[-1].frame_count},
                group=group.index,
            )
            reporter.progress(stop, f"group {group.index}")
        wanted = {group_name(group.index) for group in groups}
        for path in new.iterdir():
            if path.name not in (wanted if settings.stream_version == 2 else {"files"}):
                remove(path)
        metadata = self._metadata(context, entries).to_json()
        audio = self._sound(context, new, reporter)
        manifest = write_manifest(new, entries, context.footage.calibrated.fps, settings, metadata, audio=audio)
        if settings.stream_version == 3 and (context.take.stream / "manifest.json").is_file():
            self._update(context, new)
        else:
            self._put_in_place(context, new)
        for path in context.take.work(self.name).glob("group_*.json"):
            if path.stem not in wanted:
                remove(path)
        total = manifest.total_bytes
        return BakeSummary(
            groups=len(groups),
            frames=manifest.frame_count,
            renditions=max(1, len(settings.ladder)),
            bytes=total,
            bytes_per_frame=round(manifest.bytes_per_frame),
        )

    def parts(self, context: Context) -> tuple[Part, ...]:
        """The stream's groups, in order.

        Raises:
            StudioError: the trim leaves no frame (`edits.no_frames_left`), or the edits cannot be read.
        """
        trim = context.edits.trim
        found = parts_of(context.groups, context.config.bake.first_group_size, trim)
        if not found and trim is not None:
            last = len(context.footage.raw.frames) - 1
            raise StudioError(
                "edits.no_frames_left",
                f"the take is trimmed to frames {trim.first} to {trim.last}, but it has frames 0 to {last}",
                file=context.take.edits,
                value=[trim.first, trim.last],
                fix="Set other frames with `v3studio edit trim`, or remove the trim with `v3studio edit remove trim`.",
                expected=[0, last],
            )
        return found

    def frames_needed(self, context: Context, part: Part) -> int:
        """Number of trained frames of its group without which a part cannot be baked. All, where splats are removed,
        since all frames decide which, and where splats are fine-tuned, on frames of the whole group."""
        whole = edits_of_group(context.edits, part.trained.indices).removes or finetuned_rungs(context)
        return len(part.trained.indices) if whole else part.indices[-1] + 1 - part.trained.first

    def group_key(self, context: Context, group: Group) -> str:
        """See `GroupStage`."""
        return key_of(self.name, self.version, [self._key(context, part) for part in self._parts_of(context, group)])

    def group_done(self, context: Context, group: Group) -> bool:
        """See `GroupStage`."""
        return all(self._place(context, part) is not None for part in self._parts_of(context, group))

    def run_group(self, context: Context, group: Group, reporter: StageReporter) -> None:
        """See `GroupStage`."""
        parts = self._parts_of(context, group)
        for position, part in enumerate(parts):
            if self._place(context, part) is None:
                self._bake(context, part, reporter, position / len(parts), (position + 1) / len(parts))

    def _parts_of(self, context: Context, group: Group) -> list[Part]:
        return [part for part in self.parts(context) if part.trained.index == group.index]

    def bake_part(self, context: Context, group: Part, reporter: StageReporter) -> BakedGroup:
        """A valid baked group, baked now if there is none; for version 3.

        Raises:
            StudioError: it cannot be baked.
            Cancelled: from `reporter`.
        """
        from studio.stream import baked_group

        self._bake_once(context, group, reporter, 0.0, 1.0)
        return baked_group(read_model(self._note(context, group), BakedGroupNote).entry)

    def publish(self, context: Context, entries: Sequence[BakedGroup], live: bool, reporter: StageReporter) -> None:
        """Version 3: give the stream the files of these groups, then a manifest of them.

        Args:
            entries: the first groups of the stream, from `bake_part`.
            live: whether others follow. The sound is added with the last.
            reporter: told what the sound lacks.

        Raises:
            StudioError: the stream cannot be written.
        """
        from studio.stream import write_manifest

        stream, new = context.take.stream, self._folder(context)
        audio = None if live else self._sound(context, new, reporter)
        wanted = {file.path: file.bytes for entry in entries for file in entry.files}
        if audio is not None:
            wanted[audio.path] = audio.bytes
        for path, size in wanted.items():
            target = stream / path
            if not target.is_file() or target.stat().st_size != size:
                target.parent.mkdir(parents=True, exist_ok=True)
                with atomic_path(target) as temporary:
                    link_or_copy(str(new / path), str(temporary))
        fps, settings = context.footage.calibrated.fps, context.config.bake
        metadata = self._metadata(context, entries).to_json()
        write_manifest(stream, entries, fps, settings, metadata, live=live, audio=audio)

    def _folder(self, context: Context) -> Path:
        return context.take.work(self.name) / "stream"

    def _note(self, context: Context, group: Part) -> Path:
        """File with the key, digests and manifest entry of a baked group."""
        return context.take.work(self.name) / f"{group_name(group.index)}.json"

    def _seems_done(self, context: Context, group: Part, known: Mapping[Path, str]) -> bool:
        """Whether a group is baked; `known` are digests of files that need not be read, gigabytes in a long take."""
        if context.config.bake.stream_version != 3:
            return self._place(context, group) is not None
        if not self._note(context, group).is_file():
            return False
        note = read_model(self._note(context, group), BakedGroupNote)
        if note.key != self._key(context, group, known):
            return False
        return all(self._file(context, path, note, known) is not None for path in note.files)

    def _key(self, context: Context, group: Part, known: Mapping[Path, str] | None = None) -> str:
        """Digest of everything that the group is made from; `known` are digests of frames that need not be read."""
        edits = edits_of_group(context.edits, group.trained.indices)
        frames = [context.take.trained_frame(group.trained.index, index) for index in group.indices]
        if edits.removes:
            frames += [context.take.trained_frame(group.trained.index, index) for index in group.trained.indices]
        content = [(known or {}).get(path) or (digest_of_file(path) if path.is_file() else None) for path in frames]
        edited = edit_params(edits)
        if group.stream_first != group.first:
            edited["first frame in the stream"] = group.stream_first
        settings = settings_affecting(context.config, "videos")
        if context.config.bake.stream_version == 3:  # its level depends on it
            settings["frames a second"] = float(context.footage.raw.fps)
        rungs = RungTraining(context)
        finetuned = [rungs.key(group.trained, rung) for rung in finetuned_rungs(context)]
        return key_of(
            self.name,
            self.version,
            settings,
            group.index,
            group.first,
            content,
            *([finetuned] if finetuned else []),
            *([compared] if (compared := _compared_footage(context)) else []),
            *([edited] if edited else []),
        )

    def _place(self, context: Context, group: Part) -> Path | None:
        """Folder of a valid baked group, in the work folder or in the old stream; None if it must be baked."""
        if not self._note(context, group).is_file():
            return None
        note = read_model(self._note(context, group), BakedGroupNote)
        if note.key != self._key(context, group):
            return None
        if context.config.bake.stream_version == 3:
            found = [self._file(context, path, note) for path in note.files]
            return self._folder(context) if None not in found else None
        for folder in (self._folder(context), context.take.stream):
            place = folder / group_name(group.index)
            present = {path.name: path.stat().st_size for path in place.iterdir()} if place.is_dir() else {}
            if present == note.files and all(
                digest_of_file(place / name) == note.digests.get(name) for name in present
            ):
                return place
        return None

    def _file(
        self, context: Context, path: str, note: BakedGroupNote, known: Mapping[Path, str] | None = None
    ) -> Path | None:
        """Version 3: an undamaged file of a baked group, in the work folder or in the old stream; `known` are digests
        of files that need not be read."""
        for folder in (self._folder(context), context.take.stream):
            file = folder / path
            digest = (known or {}).get(file) or (digest_of_file(file) if file.is_file() else None)
            if digest is not None and digest == note.digests.get(path):
                return file
        return None

    def _link(self, context: Context, group: Part, new: Path) -> None:
        """Version 3: put the files of a valid group into the work folder."""
        note = read_model(self._note(context, group), BakedGroupNote)
        for path in note.files:
            file = self._file(context, path, note)
            if file is not None and file != new / path:
                (new / path).parent.mkdir(parents=True, exist_ok=True)
                remove(new / path)
                link_or_copy(str(file), str(new / path))

    def _bake_once(self, context: Context, group: Part, reporter: StageReporter, start: float, stop: float) -> None:
        """Bake a group, unless another process has done it meanwhile."""
        with context.take.group_locked(self.name, group.trained.index, lambda: reporter.progress(start)):
            if self._place(context, group) is None:
                self._bake(context, group, reporter, start, stop)

    def _bake(self, context: Context, group: Part, reporter: StageReporter, start: float, stop: float) -> None:
        from studio.stream import bake_group
        from studio.stream.suggested_view import seen_box

        remove(self._note(context, group))
        label, bake = f"group {group.index}", context.config.bake
        edited = edited_group(context, group)
        frames = EditedFrames(edited, group.indices)
        finetuned: dict[tuple[float, int | None, int], FinetunedFrames] = {}
        training, rungs = RungTraining(context), finetuned_rungs(context)
        new = [rung for rung in rungs if not training.finished(group.trained, rung)]
        share = 0.7 * (stop - start) / max(1, len(new))  # of the work, roughly
        for rung in rungs:
            end = start + share * (rung in new)
            progress = reporter.part(f"{label}: fine-tuning {rung.kept}", start, end)
            offsets = training.offsets(group.trained, rung, reporter, progress)
            finetuned[rung.kind] = FinetunedFrames(edited, group.indices, offsets)
            start = end
        error = None
        if bake.max_loss is not None:
            numbers = [context.footage.raw.frames[index] for index in group.indices]
            error = FilmedError(context, frames, numbers)
        entry = bake_group(
            frames,
            self._folder(context),
            group.index,
            group.stream_first,
            bake,
            progress=reporter.part(label, start, stop),
            quality=DrawnError(context, frames) if bake.target_psnr is not None or bake.ladder else None,
            threads=context.config.run.threads,
            fps=float(context.footage.raw.fps),
            contribution=DrawnContribution(context, frames, stream_cameras(context)),
            finetuned=lambda rung: finetuned[rung.kind],
            error=error,
        )
        if error is not None:
            _tell_losses(group, error.losses, bake, reporter)
        seen = seen_box(frames[index] for index in sorted({0, len(frames) // 2, len(frames) - 1}))
        folder = self._folder(context)
        if bake.stream_version == 3:
            files = {file.path: folder / file.path for file in entry.files}
        else:
            files = {path.name: path for path in sorted((folder / group_name(group.index)).iterdir())}
        write_model(
            self._note(context, group),
            BakedGroupNote(
                key=self._key(context, group),
                files={name: path.stat().st_size for name, path in files.items()},
                digests={name: digest_of_file(path) for name, path in files.items()},
                entry=entry.to_dict(),
                seen=None if seen is None else (tuple(seen[0].tolist()), tuple(seen[1].tolist())),
            ),
        )

    def _warn_of_limits(self, context: Context, entry: BakedGroup, reporter: StageReporter) -> None:
        from studio.stream import GroupLadder
        from studio.stream.decoder_limits import beyond_hardware

        if isinstance(entry, GroupLadder):
            for message in beyond_hardware(entry, float(context.footage.raw.fps), context.config.bake.codec):
                reporter.warn(message)

    def _sound(self, context: Context, new: Path, reporter: StageReporter) -> AudioEntry | None:
        """Encode the sound, in seconds; warns of what it lacks."""
        from studio.stream import bake_sound

        footage = context.footage.raw
        if footage.sound is None:
            return None
        if context.config.bake.stream_version == 2:
            reporter.warn(
                Message(
                    "bake.no_sound_in_version_2",
                    "streams of version 2 have no sound",
                    fix="Set bake.stream_version to 3, or capture.audio to null.",
                    fields={"setting": "bake.stream_version"},
                )
            )
            return None
        trim = context.edits.trim
        frames = footage.frames if trim is None else footage.frames[trim.first : trim.last + 1]
        cut = footage.sound.cut(frames, footage.spec.step)
        audio = bake_sound(cut, new)
        for seconds, where in ((cut.missing_before, "begins"), (cut.missing_after, "ends")):
            if seconds > SHORT_SOUND:
                when = "after the take's beginning" if where == "begins" else "before the take's end"
                reporter.warn(
                    Message(
                        "bake.short_sound",
                        f"the sound {where} {seconds:.2f} s {when}; the rest is silent",
                        file=footage.sound.path,
                        value=seconds,
                        fix="Use a longer file, or move the sound with capture.audio_offset.",
                        fields={"setting": "capture.audio_offset"},
                    )
                )
        return audio

    def _metadata(self, context: Context, entries: Sequence[BakedGroup]) -> StreamMetadata:
        """Deterministic, so that identical takes bake to identical bytes. The first view is from the first training
        camera: nothing tells where the front is, and held-out cameras are chosen for other reasons."""
        from studio.coverage import view_range
        from studio.stream import StreamMetadata
        from studio.stream.metadata import CapturePlace
        from studio.stream.suggested_view import suggested_view

        footage, world = context.footage.calibrated, context.edits.similarity
        cameras, up = stream_cameras(context), world.directions(footage.rig.up)
        boxes = []
        for part, entry in zip(self.parts(context), entries, strict=False):  # while live, of the first groups
            note = read_model(self._note(context, part), BakedGroupNote)
            boxes.append(note.seen or (entry.bounding_box.min, entry.bounding_box.max))
        low = np.min([box[0] for box in boxes], axis=0).tolist()
        high = np.max([box[1] for box in boxes], axis=0).tolist()
        if context.edits.world is not None and context.edits.world.up is not None:
            up = np.array(UP)
        camera = suggested_view(cameras[0], low, high, up)
        x, y, z = up.tolist()
        covered = None
        if context.config.bake.view_range == "auto":
            covered = view_range(cameras, (np.array(low) + np.array(high)) / 2)
        first = self.parts(context)[0].first
        place = None if first == 0 and world.is_identity else CapturePlace(first, world)
        return StreamMetadata(camera, context.config.capture.background, (x, y, z), covered, place)

    def _put_in_place(self, context: Context, new: Path) -> None:
        """Swap folders, in one step where the system can. If killed between the two renames that it takes elsewhere,
        the complete new stream is still in the work folder."""
        stream = context.take.stream
        old = context.take.work(self.name) / "old"
        remove(old)
        if stream.exists():
            if exchange(new, stream):
                remove(new)
                return
            os.rename(stream, old)
        os.rename(new, stream)
        remove(old)

    def _update(self, context: Context, new: Path) -> None:
        """Version 3: give the old stream the new files, then the new manifest; then remove what it no longer needs. If
        killed before the manifest is replaced, the old stream is still whole."""
        stream = context.take.stream
        (stream / "files").mkdir(exist_ok=True)
        wanted = {path.name for path in (new / "files").iterdir()}
        for name in wanted:
            target = stream / "files" / name
            if not target.is_file() or digest_of_file(target) != digest_of_file(new / "files" / name):
                with atomic_path(target) as temporary:
                    link_or_copy(str(new / "files" / name), str(temporary))
        sync(stream / "files")
        os.replace(new / "manifest.json", stream / "manifest.json")
        for path in (stream / "files").iterdir():
            if path.name not in wanted:
                remove(path)
        for path in stream.glob("group_*"):  # of a stream of version 2
            remove(path)
        remove(new)


def _compared_footage(context: Context) -> Params:
    """The footage with which decoded frames are compared; nothing without `bake.max_loss`."""
    if context.config.bake.max_loss is None:
        return {}
    result = result_of(context.take, "calibrate")
    return {"compared": context.footage.digest, **settings_affecting(context.config, "evaluation"), "cameras": result}


def _content_of_sound(context: Context) -> Params:
    sound = context.footage.raw.sound
    if sound is None or context.config.bake.stream_version == 2:
        return {}
    return {"sound": digest_files(sound.path.parent, [sound.path])}


def _tell_losses(part: Part, losses: Mapping[int, float], bake: BakeSettings, reporter: StageReporter) -> None:
    """Warn of frames that lose more than `bake.max_loss` in spite of lower QPs."""
    if not losses or bake.max_loss is None:
        return  # lossless, or a first rung with fewer splats
    worst = max(losses, key=lambda index: losses[index])
    text = f"frame {part.indices[worst]} loses most to encoding, {losses[worst]:.2f} dB"
    over = sum(value > bake.max_loss for value in losses.values())
    if not over:
        reporter.log(f"group {part.index}: {text}")
        return
    reporter.warn(
        Message(
            "bake.loss_above_limit",
            f"group {part.index}: {counted(over, 'frame')} above bake.max_loss {bake.max_loss:g}: {text}",
            value=round(losses[worst], 3),
            fix="Lower bake.qp, or raise bake.max_loss.",
            fields={"setting": "bake.max_loss", "group": part.index},
        )
    )


class DrawnError:
    """Image error of decoded frames against trained ones, for `bake.target_psnr`.

    Both are rendered from a few cameras around the performer and compared in the bounding box of the foreground.

    Args:
        context: of the stage.
        frames: the trained frames of the group, with the take's edits.
    """

    CAMERAS = 4
    WIDTH = 640

    def __init__(self, context: Context, frames: Sequence[Gaussians]) -> None:
        self._context, self._frames = context, frames
        cameras = stream_cameras(context)
        chosen = np.linspace(0, len(cameras), min(self.CAMERAS, len(cameras)), endpoint=False).astype(int)
        self._cameras = [cameras[index] for index in chosen]
        self._trained: dict[int, list[np.ndarray]] = {}

    def __call__(self, index: int, decoded: Gaussians) -> float:
        """Mean squared error over the cameras, colors in 0 to 1; `index` counts within the group."""
        if index not in self._trained:
            self._trained[index] = self._draw(self._frames[index])
        errors = []
        for trained, found in zip(self._trained[index], self._draw(decoded), strict=True):
            box = drawn_box(trained, self._context.config.capture.background)
            errors.append(float(np.square(trained[box] - found[box]).mean()))
        return sum(errors) / len(errors)

    def _draw(self, gaussians: Gaussians) -> list[np.ndarray]:
        context = self._context
        background = context.config.capture.background
        return [draw(gaussians, camera, background, context.device, self.WIDTH) for camera in self._cameras]


def drawn_box(image: np.ndarray, background: Sequence[float]) -> tuple[slice, slice]:
    """Rows and columns of the bounding box of everything that differs from the background; all if nothing does.

    Args:
        image: (H, W, 3), 0 to 1.
        background: RGB, 0 to 1.
    """
    differs = (np.abs(image - np.array(background, dtype=np.float32)) > 1 / 255).any(axis=2)
    rows, columns = np.flatnonzero(differs.any(axis=1)), np.flatnonzero(differs.any(axis=0))
    if rows.size == 0:
        return slice(None), slice(None)
    return slice(int(rows[0]), int(rows[-1]) + 1), slice(int(columns[0]), int(columns[-1]) + 1)


def edited_group(context: Context, part: Part) -> EditedGroup:
    """The trained group of a part, with the take's edits."""
    return EditedGroup(context.take, part.trained.index, part.trained.indices, context.edits)


def stream_cameras(context: Context) -> list[Camera]:
    """The training cameras in the world of the stream."""
    footage, world = context.footage.calibrated, context.edits.similarity
    cameras = [footage.rig[name] for name in footage.train_cameras]
    return cameras if world.is_identity else [world.camera(camera) for camera in cameras]
