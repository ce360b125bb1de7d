"""Publishes baked groups: the stream gets their files, then a manifest of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from v3studio.pipelines.stages.baking.plan import BakePlan, stream_cameras
from v3studio.pipelines.stages.reporter import StageReporter
from v3studio.pipelines.takes.files.digests import digest_of_file
from v3studio.pipelines.takes.results.stage_files import BakedGroupNote
from v3studio.studio.atomic_files import atomic_path, link_or_copy
from v3studio.studio.camera_files import read_rig
from v3studio.studio.edits.edit_list import UP
from v3studio.studio.errors import Message
from v3studio.studio.own_frame import own_frame, undone

if TYPE_CHECKING:
    from pathlib import Path

    from v3studio.studio.edits.edit_list import Trim
    from v3studio.studio.footage import Footage
    from v3studio.studio.stream import AudioEntry, GroupEntry, Manifest, StreamMetadata

SHORT_SOUND = 0.05  # seconds of silence at an end of the sound that a warning reports


def publish(plan: BakePlan, notes: Sequence[BakedGroupNote], live: bool, reporter: StageReporter) -> Manifest:
    """Write the take's stream; until then it is the earlier one. `live`: more groups follow, the last with sound."""
    from v3studio.studio.stream import GroupEntry, write_manifest

    inputs, stream = plan.inputs, plan.inputs.take.stream
    entries = [GroupEntry.from_dict(note.entry) for note in notes]
    inputs.take.forget("bake")
    for note in notes:
        for path, digest in note.digests.items():
            _put(plan, path, digest)
    for file in (file for part in plan.baked_set for file in part.files):
        _put(plan, file.path, digest_of_file(plan.folder / file.path))
    audio = None if live else _sound(inputs.raw_footage, inputs.edits.trim, plan.folder, reporter)
    if audio is not None:
        _put(plan, audio.path, digest_of_file(plan.folder / audio.path))
    fps, settings = inputs.trained_footage.fps, inputs.config.bake
    metadata = _metadata(plan, entries, notes).to_json()
    return write_manifest(stream, entries, fps, settings, metadata, live=live, audio=audio, behind=plan.baked_set)


def _put(plan: BakePlan, path: str, digest: str) -> None:
    """Link a file of the work folder into the stream, unless it is there."""
    target = plan.inputs.take.stream / path
    if not target.is_file() or digest_of_file(target) != digest:
        target.parent.mkdir(parents=True, exist_ok=True)
        with atomic_path(target) as temporary:
            link_or_copy(str(plan.folder / path), str(temporary))


def _sound(footage: Footage, trim: Trim | None, folder: Path, reporter: StageReporter) -> AudioEntry | None:
    """Encode the sound into the work folder, in seconds; warns of what it lacks."""
    from v3studio.studio.stream import bake_sound

    if footage.sound is None:
        return None
    frames = tuple(frame for frame in footage.frames if trim is None or trim.holds(frame))
    cut = footage.sound.cut(frames, footage.spec.frame_range[2])
    audio = bake_sound(cut, folder)
    for seconds, where in ((cut.missing_before, "begins"), (cut.missing_after, "ends")):
        if seconds > SHORT_SOUND:
            when = "after the take's beginning" if where == "begins" else "before the take's end"
            problem = f"the sound {where} {seconds:.2f} s {when}; the rest is silent"
            fix = "Use a longer file, or move the sound with capture.audio_offset."
            fields = {"setting": "capture.audio_offset"}
            reporter.warn(
                Message("bake.short_sound", problem, file=footage.sound.path, value=seconds, fix=fix, fields=fields)
            )
    return audio


def _metadata(plan: BakePlan, entries: Sequence[GroupEntry], notes: Sequence[BakedGroupNote]) -> StreamMetadata:
    """Make the metadata, the same for identical takes, which bake to identical bytes. The first view is from the first
    training camera: the footage does not show where the front is, and held-out cameras are chosen for other reasons."""
    from v3studio.studio.calibration.coverage import view_range
    from v3studio.studio.stream import StreamMetadata
    from v3studio.studio.stream.metadata import CapturePlace
    from v3studio.studio.stream.suggested_view import suggested_view

    inputs = plan.inputs
    footage, world = inputs.trained_footage, inputs.edits.similarity
    cameras, up = stream_cameras(inputs), world.directions(footage.rig.up)
    boxes = [
        note.seen or (entry.best.bounding_box.min, entry.best.bounding_box.max)
        for note, entry in zip(notes, entries, strict=True)
    ]
    low = np.min([box[0] for box in boxes], axis=0).tolist()
    high = np.max([box[1] for box in boxes], axis=0).tolist()
    if inputs.edits.world is not None and inputs.edits.world.up is not None:
        up = np.array(UP)
    camera = suggested_view(cameras[0], low, high, up)
    x, y, z = up.tolist()
    covered = None
    if inputs.config.bake.view_range == "auto":
        covered = view_range(cameras, (np.array(low) + np.array(high)) / 2)
    first = plan.parts[0].first
    place = None if first == 0 and world.is_identity else CapturePlace(first, world)
    original = undone(own_frame(read_rig(inputs.take.rig)), placed=inputs.edits.world is not None)
    return StreamMetadata(camera, inputs.config.evaluate.background, (x, y, z), covered, place, original)
