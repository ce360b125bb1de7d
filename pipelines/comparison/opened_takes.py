"""The takes of a comparison: their streams, their cameras, and one footage for all of them."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from v3studio.pipelines.config import load_config
from v3studio.pipelines.stages.inputs import Inputs
from v3studio.pipelines.takes.results.videos import capture_place, open_reader
from v3studio.pipelines.takes.take import Take
from v3studio.studio.camera_files import read_rig
from v3studio.studio.comparison import EvaluationProtocol, find_camera
from v3studio.studio.errors import StudioError
from v3studio.studio.own_frame import in_own_frame

if TYPE_CHECKING:
    from v3studio.studio.footage import Footage
    from v3studio.studio.stream import CapturePlace, StreamReader


@dataclass
class OpenedTake:
    """A take in a comparison."""

    name: str
    take: Take
    reader: StreamReader
    place: CapturePlace  # where the stream lies in the take
    footage: Footage  # of the comparison, seen through this take's cameras
    frames: dict[int, int]  # footage frame to index in the stream
    trained_on: tuple[str, ...]  # cameras that it was trained on
    group_starts: frozenset[int]  # footage frames with which groups begin


def open_takes(
    folders: Sequence[Path], protocol: EvaluationProtocol, cameras: Sequence[str], closing: ExitStack, footage: Path
) -> tuple[list[OpenedTake], tuple[str, ...]]:
    """Open takes for a comparison: the takes, and the names of the cameras.

    Images and masks come from the footage settings of the take in the folder `footage`, so that all are compared with
    the same; each take is rendered with its own calibration. StudioError if a take has no stream, a camera
    is missing (`compare.no_such_camera`), or none is held out (`compare.no_held_out`).
    """
    from v3studio.studio.footage import open_footage

    first = _inputs(footage)
    names = _cameras(first, protocol, cameras)
    spec = first.capture.replace(cameras=names, held_out=(), scale=protocol.scale or first.capture.scale)
    run = first.config.run
    seen: dict[bytes, Footage] = {}
    opened: list[OpenedTake] = []
    for folder, name in zip(folders, _names(folders), strict=True):
        own = _inputs(folder)
        # takes with the same cameras share decoded images
        key = own.take.rig.read_bytes() if own.take.rig.is_file() else b""
        if key not in seen:
            rig = in_own_frame(read_rig(own.take.rig))
            seen[key] = open_footage(
                spec,
                rig,
                cache_folder=first.take.footage_cache,
                device=run.device,
                threads=run.thread_count,
                evaluation_masks=first.config.evaluate.exact_masks,
            )
        opened.append(_opened(name, own, seen[key], closing))
    return opened, names


def _inputs(folder: Path) -> Inputs:
    take = Take.open(folder)
    return Inputs(take, load_config(take.config))


def _opened(name: str, own: Inputs, footage: Footage, closing: ExitStack) -> OpenedTake:
    take = own.take
    reader = closing.enter_context(open_reader(str(take.root)))
    frames = own.raw_footage.frames
    place = capture_place(reader)
    first, count = place.first_frame, reader.frame_count
    # a trimmed stream has fewer frames than its take
    if first + count > len(frames) or (count != len(frames) and own.edits.trim is None):
        problem = f"the stream has {reader.frame_count} frames, but the take has {len(frames)}"
        fix = "Run `v3studio bake`."
        raise StudioError(
            "stream.frame_count", problem, file=take.stream, value=reader.frame_count, fix=fix, expected=len(frames)
        )
    starts = frozenset(frames[first + group.first_frame] for group in reader.groups)
    indices = {frame: index for index, frame in enumerate(frames[first : first + count])}
    return OpenedTake(name, take, reader, place, footage, indices, own.raw_footage.train_cameras, starts)


def _cameras(inputs: Inputs, protocol: EvaluationProtocol, cameras: Sequence[str]) -> tuple[str, ...]:
    known = inputs.calibrated_footage.camera_names
    wanted = tuple(cameras) or protocol.cameras
    if not wanted:
        if not inputs.calibrated_footage.measured_cameras:
            problem = "no camera with masks is held out, so nothing measures new views"
            fix = "Name the cameras to measure with --cameras A,B."
            raise StudioError("compare.no_held_out", problem, file=inputs.take.root, fix=fix, option="--cameras")
        return inputs.calibrated_footage.measured_cameras
    names = []
    for one in wanted:
        name = find_camera(one, known)
        if name is None:
            asked = "" if cameras else f", which protocol {protocol.name} measures"
            problem = f"the footage has no camera '{one}'{asked}"
            fix = f"Name others with --cameras A,B. Cameras: {', '.join(known)}."
            raise StudioError(
                "compare.no_such_camera", problem, file=inputs.take.root, value=one, fix=fix, option="--cameras"
            )
        names.append(name)
    return tuple(dict.fromkeys(names))


def _names(folders: Sequence[Path]) -> list[str]:
    """The last parts of the paths, as many as tell them apart."""
    parts = [folder.absolute().parts for folder in folders]
    for count in range(1, max(map(len, parts)) + 1):
        names = ["/".join(each[-count:]) for each in parts]
        if len(set(names)) == len(names):
            return names
    problem = "the same take is named twice"
    raise StudioError("compare.same_take", problem, value=str(folders[0]), fix="Name each take once.")
