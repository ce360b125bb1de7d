"""`v3studio edit`: trims, crops, cleans and places a take, and marks details for training."""

from __future__ import annotations

import argparse
import shlex
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from v3studio.pipelines.commands.common.arguments import add_command, frame_range, invalid_option, number, print_text
from v3studio.studio.counts import counted
from v3studio.studio.errors import StudioError, violation

if TYPE_CHECKING:
    import numpy as np

    from v3studio.pipelines.takes.take import Take
    from v3studio.studio.edits import EditList
    from v3studio.studio.footage import Footage

_NOTE = """Edits are stored in the take's edits.json. They affect bakes, evaluations and exports; `v3studio run` bakes
what is affected again. Only `detail`, `mask` and `crop --training` affect
training.

Examples:
    v3studio edit trim takes/first 12:251
    v3studio edit crop takes/first --min -0.8 -0.8 0 --max 0.8 0.8 2
    v3studio edit floaters takes/first --share 0.01
    v3studio edit detail takes/first --frame 0 --at 0 0.1 1.6 --radius 0.15
    v3studio edit mask takes/first --camera cam09 --frame 7 --performer 310 120
    v3studio edit undo takes/first
"""


def register(commands: Any) -> None:
    text = "trim a take, crop it, remove floaters, set axes and scale, mark details; with undo"
    command = add_command(commands, "edit", text, epilog=_NOTE)
    kinds = command.add_subparsers(title="commands", required=True, metavar="COMMAND")

    _kind(kinds, "list", "show the edits", _list)
    _kind(kinds, "count", "count the splats that the edits remove, by group", _count)

    trim = _kind(kinds, "trim", "keep a range of frames", _trim)
    trim.add_argument(
        "frames", type=frame_range, metavar="A:B", help="keep the frames A to B - 1, by their numbers in the footage"
    )

    crop = _kind(kinds, "crop", "remove what is outside of a box", _crop)
    _vector(crop, "--min", "lowest corner of the box, in the world of `v3studio edit world`", required=True)
    _vector(crop, "--max", "highest corner", required=True)
    crop.add_argument(
        "--training", action="store_true", help="also mask the training images to the box; trains the take again"
    )

    ground = _kind(kinds, "ground", "remove what is below a plane", _ground)
    ground.add_argument(
        "height", type=float, metavar="HEIGHT", help="height along the up direction, in the world of `edit world`"
    )

    floaters = _kind(kinds, "floaters", "remove faint splats, and small clusters apart from all others", _floaters)
    floaters.add_argument("--opacity", type=float, metavar="X", help="remove splats whose opacity never exceeds X")
    floaters.add_argument("--splats", type=int, metavar="N", help="remove clusters of fewer than N splats")
    floaters.add_argument("--share", type=float, metavar="X", help="remove clusters below this share of the splats")
    floaters.add_argument(
        "--distance",
        type=float,
        metavar="D",
        help="splats closer than this are in one cluster; in units of the capture (default: 2%% of the performer)",
    )

    world = _kind(kinds, "world", "set the up direction, origin and scale of streams and exports", _world)
    _vector(world, "--up", "direction that becomes +y, in the world of the capture")
    _vector(world, "--origin", "point that becomes the origin, in the world of the capture")
    world.add_argument("--scale", type=float, metavar="S", help="new units per unit of the capture")
    _vector(world, "--from", "instead of --scale, with --to and --distance: a point in the world of the capture")
    _vector(world, "--to", "another point")
    world.add_argument("--distance", type=float, metavar="D", help="distance of the two points in new units")

    detail = _kind(kinds, "detail", "mark a part of the performer (face, hand) for training in more detail", _detail)
    detail.add_argument(
        "--frame", type=int, metavar="F", help="trained frame, by its number in the footage (default: the first)"
    )
    _vector(detail, "--at", "center of a ball around the part, in the world of `v3studio edit world`", required=True)
    detail.add_argument("--radius", type=float, required=True, metavar="R", help="radius of the ball")
    detail.add_argument(
        "--weight",
        type=float,
        default=4.0,
        metavar="W",
        help="how much more pixels and splats in the ball count, from 1 to 100 (default: 4)",
    )

    mask = _kind(kinds, "mask", "correct a mask by clicks, also in near frames and other cameras", _mask)
    mask.add_argument("--camera", required=True, metavar="NAME", help="camera in whose image the pixels are")
    mask.add_argument("--frame", type=int, required=True, metavar="F", help="frame, by its number in the footage")
    for name, text in (("performer", "on the performer"), ("background", "on what is not the performer")):
        mask.add_argument(
            f"--{name}", type=_coordinate, nargs=2, action="append", default=[], metavar=("X", "Y"),
            help=f"column and row of a pixel {text}, from the upper left corner of the image; may be repeated",
        )  # fmt: skip

    remove = _kind(kinds, "remove", "remove an edit", _remove)
    names = "trim, crop, ground, floaters, world, regions, details, masks, or all"
    remove.add_argument("name", metavar="NAME", help=names)
    remove.add_argument(
        "number",
        type=int,
        nargs="?",
        metavar="NUMBER",
        help="number of a region, detail or mask (see `list`)",
    )

    _kind(kinds, "undo", "undo the last change", partial(_step, "undo"))
    _kind(kinds, "redo", "redo the last undone change", partial(_step, "redo"))


def _kind(
    kinds: Any, name: str, text: str, command: Callable[[argparse.Namespace, Take, EditList], str]
) -> argparse.ArgumentParser:
    """Add a command that gets the edits before it and returns what it says to people; its result is those after it."""

    def run(arguments: argparse.Namespace) -> None:
        from v3studio.pipelines.takes.authored.edits import read_edits
        from v3studio.pipelines.takes.take import Take

        take = Take.open(arguments.take)
        words = command(arguments, take, read_edits(take.edits))
        arguments.result = arguments.result or read_edits(take.edits).model_dump(mode="json")
        print_text(arguments, words)

    parser = add_command(kinds, name, text, run)
    parser.add_argument("take", type=Path, metavar="TAKE", help="folder of the take")
    return parser


def _vector(parser: argparse.ArgumentParser, name: str, text: str, required: bool = False) -> None:
    parser.add_argument(
        name, type=_coordinate, nargs=3, metavar=("X", "Y", "Z"), dest=name[2:] + "_point", help=text, required=required
    )


def _coordinate(text: str) -> float:
    value = number(text)
    if not abs(value) <= 1e12:
        raise argparse.ArgumentTypeError(f"{text} is not a coordinate between -1e12 and 1e12")
    return value


def _list(arguments: argparse.Namespace, take: Take, edits: EditList) -> str:
    from v3studio.pipelines.takes.authored.edits import describe, frame_of, read_edits_file

    file = read_edits_file(take.edits)
    lines = [f"{name:<12}{words}" for name, words in describe(file.edits, frame_of(take)).items()]
    if file.edits == type(file.edits)():
        lines.append("no edits")
    if file.undo:
        lines.append(f"last change: {file.undo[-1].words}")
    return "\n".join(lines)


def _count(arguments: argparse.Namespace, take: Take, edits: EditList) -> str:
    from v3studio.pipelines.takes.frames.edited import EditedGroup
    from v3studio.pipelines.takes.frames.frame_numbers import trained_groups

    groups = trained_groups(take)
    if not groups:
        problem = "no trained frames yet"
        raise StudioError("take.not_trained", problem, file=take.root, fix="Run `v3studio train`.", stage="train")
    lines, rows = [], []
    for group in groups:
        selection = EditedGroup(take, group, edits).selection()
        counts = {name: count for name, count in selection.counts.items() if count}
        removed, splats = int(selection.removed.sum()), len(selection.removed)
        rows.append({"group": group.index, "splats": splats, "removed": removed, "by_edit": counts})
        kinds = ", ".join(f"{name} {count:,}" for name, count in counts.items())
        lines.append(
            f"group {group.index}: {removed:,} of {counted(splats, 'splat')} removed{f' ({kinds})' if kinds else ''}"
        )
    arguments.result = {"groups": rows}
    return "\n".join(lines)


def _trim(arguments: argparse.Namespace, take: Take, edits: EditList) -> str:
    (start, stop, step), footage = arguments.frames, _footage(take)
    frames = () if footage is None else footage.frames
    if step != 1 or (None in (start, stop) and not frames):
        raise invalid_option("A:B", "the frames to keep have a beginning, an end and no step", "Example: 12:251.")
    first, last = frames[0] if start is None else start, frames[-1] if stop is None else stop - 1
    outside = [frame for frame in (first, last) if frames and not frames[0] <= frame <= frames[-1]]
    if outside:
        problem = f"the take has no frame {outside[0]}"
        fix = f"It has frames {frames[0]} to {frames[-1]}."
        raise invalid_option("A:B", problem, fix, outside[0], expected=[frames[0], frames[-1]])
    return _change(take, edits, "trim", {"first": first, "last": last})


def _crop(arguments: argparse.Namespace, take: Take, edits: EditList) -> str:
    import numpy as np

    from v3studio.pipelines.takes.authored.edits import frame_of, placed_world
    from v3studio.studio.rotations import matrices_to_quats

    back = placed_world(edits, frame_of(take)).inverse
    low, high = np.array(arguments.min_point), np.array(arguments.max_point)
    if not (low < high).all():
        words = [" ".join(f"{value:g}" for value in corner) for corner in (low, high)]
        problem = f"--min {words[0]} is not below --max {words[1]} on every axis"
        raise invalid_option("--min", problem, "Example: --min -1 -1 0 --max 1 1 2.", words[0])
    box: dict[str, object] = {
        "center": back.points((low + high) / 2).tolist(),
        "size": (back.scale * (high - low)).tolist(),
        "training": arguments.training,
    }
    if not np.array_equal(back.rotation, np.eye(3)):
        box["rotation"] = matrices_to_quats(back.rotation).tolist()
    return _change(take, edits, "crop", box)


def _ground(arguments: argparse.Namespace, take: Take, edits: EditList) -> str:
    from v3studio.pipelines.takes.authored.edits import frame_of, placed_world

    normal = _up(take, edits)
    placed = placed_world(edits, frame_of(take))
    point = placed.inverse.points(arguments.height * placed.directions(normal))
    return _change(take, edits, "ground", {"normal": normal.tolist(), "height": float(point @ normal)})


def _up(take: Take, edits: EditList) -> np.ndarray:
    """(3,) unit vector: up in the world of the capture."""
    import numpy as np

    from v3studio.studio.camera_files import read_rig

    if edits.world is not None and edits.world.up is not None:
        up = np.array(edits.world.up)
        direction: np.ndarray = up / np.linalg.norm(up)
        return direction
    if not take.rig.is_file():
        problem = "the take has no cameras yet, so it is not known where up is"
        fix = "Run `v3studio calibrate`, or set it with `v3studio edit world TAKE --up X Y Z`."
        raise StudioError("edits.no_up", problem, file=take.root, fix=fix, stage="calibrate")
    return read_rig(take.rig).up


def _floaters(arguments: argparse.Namespace, take: Take, edits: EditList) -> str:
    names = ("opacity", "splats", "share", "distance")
    given = {name: getattr(arguments, name) for name in names if getattr(arguments, name) is not None}
    return _change(take, edits, "floaters", given)


def _world(arguments: argparse.Namespace, take: Take, edits: EditList) -> str:
    import numpy as np

    from v3studio.pipelines.takes.authored.edits import frame_of

    world: dict[str, object] = {} if edits.world is None else edits.world.model_dump(mode="json")
    if arguments.up_point is not None:
        world["up"] = arguments.up_point
    if arguments.origin_point is not None:
        world["origin"] = frame_of(take).points(np.array(arguments.origin_point)).tolist()
    measured = [arguments.from_point, arguments.to_point, arguments.distance]
    if any(point is not None for point in measured):
        if any(point is None for point in measured) or arguments.scale is not None:
            problem = "--from, --to and --distance are used together, and without --scale"
            raise invalid_option("--distance", problem, "Example: --from 0 0 0 --to 0 1.1 0 --distance 1.8.")
        apart = float(np.linalg.norm(np.subtract(arguments.to_point, arguments.from_point)))
        if not (apart > 0 and arguments.distance > 0):
            problem = "the two points are the same, or their distance is not above 0"
            fix = "Specify two different points and a distance above 0."
            raise invalid_option("--distance", problem, fix, arguments.distance)
        world["scale"] = arguments.distance / apart
    elif arguments.scale is not None:
        world["scale"] = arguments.scale
    return _change(take, edits, "world", world)


def _detail(arguments: argparse.Namespace, take: Take, edits: EditList) -> str:
    import numpy as np

    from v3studio.pipelines.takes.authored.edits import frame_of, placed_world
    from v3studio.pipelines.takes.frames.edited import followed

    back = placed_world(edits, frame_of(take)).inverse
    center, radius = back.points(np.array(arguments.at_point)), back.scale * arguments.radius
    before = [edit.model_dump(mode="json") for edit in edits.details]
    numbers = {"radius": radius, "weight": arguments.weight, "path": [(0, center.tolist())]}
    _checked(edits, "details", [*before, numbers])
    mark = followed(take, arguments.frame, center, radius, arguments.weight)
    return _change(take, edits, "details", [*before, mark.model_dump(mode="json")])


def _mask(arguments: argparse.Namespace, take: Take, edits: EditList) -> str:
    footage, camera, frame = _footage(take), arguments.camera, arguments.frame
    if footage is not None and camera not in footage.camera_names:
        fix = f"Choose one of {', '.join(footage.camera_names)}."
        raise invalid_option("--camera", f"the footage has no camera '{camera}'", fix, camera)
    if footage is not None and frame not in footage.frames:
        fix = f"It has frames {footage.frames[0]} to {footage.frames[-1]}."
        raise invalid_option("--frame", f"the take has no frame {frame}", fix, frame)
    clicks = [
        {"camera": camera, "frame": frame, "at": at, "performer": performer}
        for performer, places in ((True, arguments.performer), (False, arguments.background))
        for at in places
    ]
    if not clicks:
        problem = "neither --performer nor --background is given"
        raise invalid_option("--performer", problem, "Example: --performer 310 120.")
    return _change(take, edits, "masks", [*(edit.model_dump(mode="json") for edit in edits.masks), *clicks])


def _remove(arguments: argparse.Namespace, take: Take, edits: EditList) -> str:
    from v3studio.pipelines.takes.authored.edits import MANY, change_edits, singular
    from v3studio.studio.edits.edit_list import EditList

    name, known = MANY.get(arguments.name, arguments.name), [*EditList.model_fields, "all"]
    if name not in known:
        raise invalid_option("NAME", f"there is no edit named '{name}'", f"Choose one of {', '.join(known)}.", name)
    if arguments.number is not None:
        if name not in MANY.values() or not 1 <= arguments.number <= len(getattr(edits, name)):
            fix = f"`v3studio edit list {shlex.quote(str(arguments.take))}` shows the numbers."
            raise invalid_option("NUMBER", f"there is no {singular(name)} {arguments.number}", fix, arguments.number)
        new = edits.without(name, arguments.number - 1)
        change_edits(take.edits, new, f"{singular(name)} {arguments.number} removed", edits)
    elif name == "all":
        change_edits(take.edits, EditList(), "all edits removed", edits)
    elif not getattr(edits, name):
        missing = f"are no {name}" if name in MANY.values() else f"is no {name} edit"
        return f"nothing to remove: there {missing}"
    else:
        change_edits(take.edits, edits.without(name), f"{name} removed", edits)
    return f"removed: {name if arguments.number is None else singular(f'{name} {arguments.number}')}"


def _step(name: Literal["undo", "redo"], arguments: argparse.Namespace, take: Take, edits: EditList) -> str:
    from v3studio.pipelines.takes.authored.edits import step_edits

    return f"{name}ne: {step_edits(take.edits, name)}"


def _change(take: Take, before: EditList, name: str, value: object) -> str:
    """Set an edit to JSON-ready values; returns what it is now, in words."""
    from v3studio.pipelines.takes.authored.edits import change_edits, describe, frame_of

    after = _checked(before, name, value)
    words = list(describe(after, frame_of(take)).items())
    shown = [f"{edit}: {text}" for edit, text in words if edit.split()[0] == name][-1:]
    change_edits(take.edits, after, (shown or [name])[0], before)
    return "".join(shown)


def _checked(before: EditList, name: str, value: object) -> EditList:
    """The edits with one of them changed; arguments as in `_change`."""
    from pydantic import ValidationError

    from v3studio.pipelines.takes.authored.edits import MANY, singular
    from v3studio.studio.edits.edit_list import EditList

    try:
        return EditList.model_validate(before.model_dump(mode="json") | {name: value})
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(part for part in first["loc"] if isinstance(part, str) and part not in MANY.values()) or name
        given = None if isinstance(first["input"], dict | list | tuple) else first["input"]
        problem = f"{where}{'' if given is None else f' = {given}'} {violation(first)}"
        fix = f"`v3studio edit {singular(name)} --help` shows what is possible."
        if first["type"] == "too_long":
            fix = f"Remove one first: `v3studio edit remove TAKE {singular(name)} NUMBER`."
        raise invalid_option(where, problem, fix, given, edit=name) from None


def _footage(take: Take) -> Footage | None:
    """The take's footage; None if it cannot be opened here."""
    from v3studio.pipelines.config import load_config
    from v3studio.pipelines.stages.inputs import Inputs

    with suppress(StudioError):
        return Inputs(take, load_config(take.config)).raw_footage
    return None
