"""edits.json: the edits of a take, with those before each change, for undo; as parameters of stages, and in words.

The window and `v3studio edit` change the same file. A change is made under a lock and says what it replaces, so that
neither loses what the other wrote.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from v3studio.pipelines.takes.files.json_files import read_json, validated
from v3studio.pipelines.takes.files.locks import changing
from v3studio.pipelines.takes.take import Take
from v3studio.studio.atomic_files import write_json
from v3studio.studio.camera_files import read_rig
from v3studio.studio.edits.edit_list import (
    CropBox,
    DetailMark,
    EditList,
    Floaters,
    Ground,
    MaskClick,
    Region,
    Trim,
    World,
)
from v3studio.studio.errors import StudioError
from v3studio.studio.json_types import JsonData
from v3studio.studio.own_frame import own_frame, undone
from v3studio.studio.similarity import Similarity

EDITS_FORMAT = 1  # version of edits.json
MOST_STEPS = 50  # changes that can be undone
MAX_FILE_BYTES = 16_000_000  # larger files are refused; the oldest changes are forgotten before a file gets this large

MANY = {"region": "regions", "detail": "details", "mask": "masks"}
"""Edits of which there may be several: the name of one, and of all."""

_KEPT_BYTES = 4_000_000
_SHOW = "See the edits that there are with `v3studio edit list TAKE`."


class Step(BaseModel):
    """A change: what it was, and the edits on its other side."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    words: str = Field(max_length=200)  # what was changed: "trim to frames 3 to 20"
    edits: EditList  # before the change, of those to undo; after it, of those to redo


class EditsFile(BaseModel):
    """Contents of edits.json."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    format: int = EDITS_FORMAT
    edits: EditList = EditList()
    undo: tuple[Step, ...] = Field(default=(), max_length=MOST_STEPS)
    redo: tuple[Step, ...] = Field(default=(), max_length=MOST_STEPS)


def read_edits(path: Path) -> EditList:
    """The edits of a take, none without a file; StudioError if it is not what this module writes
    (`take.edits_damaged`), or of a later version (`take.edits_unknown_format`)."""
    return read_edits_file(path).edits


def read_edits_file(path: Path) -> EditsFile:
    """The edits and their history; see `read_edits`."""
    if not path.exists():
        return EditsFile()
    try:
        content: Any = read_json(path, MAX_FILE_BYTES)
        if isinstance(content, dict) and content.get("format") != EDITS_FORMAT:
            problem = f"edits of format {content.get('format')!r}; this version reads format {EDITS_FORMAT}"
            fix = "Use the version that wrote it."
            raise StudioError("take.edits_unknown_format", problem, file=path, value=content.get("format"), fix=fix)
        return validated(path, content, EditsFile)
    except StudioError as error:
        if error.code == "take.edits_unknown_format":
            raise
        fix = "Fix the file, or move it elsewhere to start over."
        raise StudioError("take.edits_damaged", f"the edits are damaged: {error.problem}", file=path, fix=fix) from None


def change_edits(path: Path, edits: EditList, words: str, replaces: EditList | None = None) -> EditsFile:
    """Replace the edits of a take by others; the change can be undone. If they are the present ones, nothing is
    written. `replaces`: the edits as they were when the change was begun; None: whatever they are.

    StudioError if the edits are others by now (`take.edits_changed`), or the file is damaged (as `read_edits`) or
    cannot be written (`take.disk_full`, `take.not_writable`).
    """
    with changing(path):
        file = read_edits_file(path)
        if replaces is not None and file.edits != replaces:
            fix = "Look at them, then make the change again."
            raise StudioError("take.edits_changed", "the edits were changed in the meantime", file=path, fix=fix)
        if file.edits == edits:
            return file
        step = Step(words=words[:200], edits=file.edits)
        return _write(path, EditsFile(edits=edits, undo=(*file.undo, step)[-MOST_STEPS:]))


def step_edits(path: Path, name: Literal["undo", "redo"]) -> str:
    """Take the last change back, or make the one that was undone last again; returns what that was. Raises StudioError:
    `take.nothing_to_undo`, `take.nothing_to_redo`."""
    back = "undo" if name == "redo" else "redo"
    with changing(path):
        file = read_edits_file(path)
        steps: tuple[Step, ...] = getattr(file, name)
        if not steps:
            raise StudioError(f"take.nothing_to_{name}", f"there is no edit to {name}", file=path, fix=_SHOW)
        step = steps[-1]
        kept = (*getattr(file, back), Step(words=step.words, edits=file.edits))[-MOST_STEPS:]
        _write(path, EditsFile.model_validate({"edits": step.edits, name: steps[:-1], back: kept}))
        return step.words


def _write(path: Path, file: EditsFile) -> EditsFile:
    """Write the file, without the oldest changes if they are too large."""
    undo = list(file.undo)
    size = sum(len(step.model_dump_json()) for step in undo)
    while len(undo) > 1 and size > _KEPT_BYTES:
        size -= len(undo.pop(0).model_dump_json())
    file = file.model_copy(update={"undo": tuple(undo)})
    write_json(path, file.model_dump(mode="json", exclude_defaults=True) | {"format": file.format}, durable=True)
    return file


def no_frames_left(take: Take, trim: Trim, frames: Sequence[int]) -> StudioError:
    """The error for a take that has none of the frames that its trim keeps; `frames`: their numbers in the footage."""
    return StudioError(
        "edits.no_frames_left",
        f"the take is trimmed to frames {trim.first} to {trim.last}, but it has frames {frames[0]} to {frames[-1]}",
        file=take.edits,
        value=[trim.first, trim.last],
        fix="Set other frames with `v3studio edit trim`, or remove the trim with `v3studio edit remove trim`.",
        expected=[frames[0], frames[-1]],
    )


PREFIX = "edits."  # of the names of parameters that are edits


def edit_params(edits: EditList, *names: str) -> dict[str, JsonData]:
    """The edits of these names (none: all but marked details and masks, which training uses), as parameters of a
    stage: nothing without edits, so that results without them stay as they are."""
    dumped = edits.model_dump(mode="json")
    if dumped["crop"] is not None:
        del dumped["crop"]["training"]  # whether training sees the box, too, changes nothing here
    chosen = names or [name for name in dumped if name not in ("details", "masks")]
    return {f"{PREFIX}{name}": dumped[name] for name in chosen if dumped[name] not in (None, [])}


def frame_of(take: Take) -> Similarity:
    """The transform from the world of the take's cameras to its own frame; the identity if it has no cameras yet."""
    return own_frame(read_rig(take.rig)) if take.rig.is_file() else Similarity()


def placed_world(edits: EditList, frame: Similarity) -> Similarity:
    """The transform from the take's own frame to the world that the edits place, else to that of its cameras."""
    return undone(frame, placed=edits.world is not None).after(edits.similarity)


def describe(edits: EditList, frame: Similarity | None = None) -> dict[str, str]:
    """Words for each edit, by name: `regions 1`, `regions 2`, ..., `details 1`, `masks 1`. With a
    `frame` from `frame_of`, positions and sizes are in the world that the edits place, else in that of the cameras, as
    `v3studio edit` takes them; without, in the take's own frame."""
    placed = edits.similarity if frame is None else placed_world(edits, frame)
    if frame is not None and edits.world is not None:
        origin = frame.inverse.points(np.array(edits.world.origin)).tolist()
        edits = edits.model_copy(update={"world": edits.world.model_copy(update={"origin": tuple(origin)})})
    sentences: dict[str, str] = {}
    for name in EditList.model_fields:
        value = getattr(edits, name)
        if isinstance(value, tuple):
            sentences |= {f"{name} {number}": words_of(edit, placed) for number, edit in enumerate(value, 1)}
        elif value is not None:
            sentences[name] = words_of(value, placed)
    return sentences


def singular(name: str) -> str:
    """A kind of edit, or a name of `describe`, as people say it: "region 1" for "regions 1"."""
    kind, space, number = name.partition(" ")
    return f"{kind.removesuffix('s') if kind in MANY.values() else kind}{space}{number}"


def words_of(
    edit: Trim | CropBox | Ground | Floaters | Region | World | DetailMark | MaskClick, placed: Similarity
) -> str:
    """An edit in a few words, with positions and sizes in the world to which `placed` leads from the capture's.

    The world itself is described in that of the capture, and distances between clusters are in its units.
    """
    match edit:
        case Trim():
            return f"frames {edit.first} to {edit.last}"
        case CropBox():
            size = " x ".join(f"{placed.scale * value:.4g}" for value in edit.size)
            center = _point(placed.points(np.array(edit.center)))
            return f"box of {size} around {center}{', also for training' if edit.training else ''}"
        case Ground():
            normal = placed.directions(np.array(edit.normal))
            height = placed.points(edit.height * np.array(edit.normal)) @ normal
            return f"nothing below {height:.4g} along {_point(normal)}"
        case Floaters():
            return ", ".join(limit_words(edit))
        case Region():
            kind = "lasso" if edit.radius is None else "brush"
            near, far = (placed.scale * (limit or 0.0) for limit in (edit.near, edit.far))
            depth = "" if edit.far is None else f", depth {near:.4g} to {far:.4g}"
            if edit.frames is None:
                return f"{kind}, all frames{depth}"
            first, last = edit.frames
            return f"{kind}, {f'the group of frame {first}' if first == last else f'frames {first} to {last}'}{depth}"
        case DetailMark():
            (first, place), (last, _) = edit.path[0], edit.path[-1]
            frames = f"frame {first}" if first == last else f"frames {first} to {last}, in the first"
            ball = f"radius {placed.scale * edit.radius:.4g}, weight {edit.weight:g}"
            return f"{ball}, {frames} at {_point(placed.points(np.array(place)))}"
        case MaskClick():
            kind = "performer" if edit.performer else "not the performer"
            return f"{edit.camera}, frame {edit.frame}: {kind} at {edit.at[0]:.4g}, {edit.at[1]:.4g}"
        case World():
            parts = [] if edit.up is None else [f"up {_point(edit.up)}"]
            parts += [f"origin {_point(edit.origin)}"] if any(edit.origin) else []
            parts += [f"scale {edit.scale:.6g}"] if edit.scale != 1 else []
            return ", ".join(parts) or "as captured"


def limit_words(floaters: Floaters) -> list[str]:
    """Words for each limit of floaters that is set."""
    limits = [] if floaters.opacity is None else [f"splats that never reach opacity {floaters.opacity:.4g}"]
    if floaters.splats is not None:
        limits.append(f"clusters of fewer than {floaters.splats:,} splats")
    if floaters.share is not None:
        limits.append(f"clusters of less than {100 * floaters.share:.4g}% of the splats")
    if floaters.distance is not None:
        limits.append(f"clusters {floaters.distance:.4g} apart")
    return limits


def _point(coordinates: Sequence[float] | np.ndarray) -> str:
    # zero must not be "-0", as turns make of it
    return f"({', '.join(f'{value + 0.0:.4g}' for value in np.round(coordinates, 12))})"
