"""`v3studio check`: finds damaged files of a take or a stream."""

from __future__ import annotations

import argparse
import shlex
from contextlib import closing, nullcontext
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from v3studio.pipelines.commands.common.arguments import add_command, invalid_option
from v3studio.pipelines.commands.common.working import working
from v3studio.pipelines.reports.terminal import say
from v3studio.studio.counts import counted
from v3studio.studio.errors import StudioError, shown
from v3studio.studio.progress import ProgressFn, part_of

if TYPE_CHECKING:
    from v3studio.pipelines.takes.take import Take


def register(commands: Any) -> None:
    more = (
        "Results of a take and files of a stream are compared with the checksums that were recorded when they were "
        "written. Of footage, all frames and masks are read, and a card is measured on a few of them: whether cameras "
        "are in time, fit the camera file, and have the right masks and the same colors. Exit code 1 if a file is "
        "damaged, changed or missing, or if the card has something wrong."
    )
    command = add_command(commands, "check", "find damaged files of a take, a stream or footage", _check, more)
    command.add_argument(
        "place", metavar="PLACE", help="folder of a take, a stream or footage, a .v3s file, or the URL of a stream"
    )
    command.add_argument(
        "--remove", action="store_true", help="delete damaged files of a take, so that the next run makes them"
    )
    command.add_argument(
        "--card", type=Path, metavar="PNG", help="image of the card of footage (default: its name, -card.png)"
    )


def _check(arguments: argparse.Namespace) -> int:
    place = Path(arguments.place).expanduser()
    if place.name == "take.json" and place.is_file():
        place = place.parent
    # an address is a stream, and so is a folder with a manifest
    if "://" in arguments.place or not place.is_dir() or (place / "manifest.json").is_file():
        return _check_stream(arguments)
    from v3studio.pipelines.takes.take import Take

    try:
        take = Take.open(place)
    except StudioError as error:
        if error.code != "take.not_a_take" or error.fields["lost"] or not any(place.iterdir()):
            raise
        return _check_footage(arguments, place)
    return _check_take(arguments, take, place)


def _check_footage(arguments: argparse.Namespace, folder: Path) -> int:
    """Check what a run would read: the footage, and with the camera file, if there is one."""
    from v3studio.pipelines.commands.common.source import read_settings
    from v3studio.pipelines.inspection import found_lines, with_camera_file
    from v3studio.pipelines.reports.images import write_image
    from v3studio.studio.card import Sample, draw, measure
    from v3studio.studio.footage import check_footage, open_footage

    capture, card = read_settings(folder).capture, None
    picture = arguments.card or Path(f"{folder.resolve().name}-card.png")
    with working("check", arguments) as report, closing(open_footage(capture, None, strict=False)) as footage:
        lines, refused, opened = list(found_lines(footage)), "", footage
        try:
            opened = with_camera_file(footage)
        except StudioError as error:
            refused = str(error)
            lines = [line for line in lines if line != refused]
        with closing(opened):
            sample = Sample(opened)
            checked = check_footage(opened, part_of(report, 0, 80), see=sample.see)
            problems = [*map(str, checked), *([refused] if refused else [])]
            if not problems:
                measured = measure(opened, part_of(report, 80, 100), sample)
                write_image(picture, draw(measured))
                card = measured.card
    arguments.result = {"footage": lines, "problems": problems, "card": card and card.model_dump(mode="json")}
    if not arguments.json:
        images = counted(len(footage.frames) * len(footage.camera_names), "image")
        say("\n".join([*lines, *problems, f"{images} checked, {len(problems) or 'no'} problems"]))
        if card is not None:
            say("\n".join([*card.lines, f"{picture}: the card"]))
    return 1 if problems or (card is not None and card.is_wrong) else 0


def _check_take(arguments: argparse.Namespace, take: Take, folder: Path) -> int:
    from v3studio.pipelines.stages import STAGE_NAMES
    from v3studio.pipelines.takes.results.integrity import check_take

    report: ProgressFn
    # what is deleted must not have been made again since it was checked
    with take.locked("v3studio check --remove") if arguments.remove else nullcontext():
        with working("check", arguments) as report:
            checked = check_take(take, STAGE_NAMES, report)
        for damage in checked.damage if arguments.remove else ():
            path = take.root / damage.file
            if not damage.stage:  # no run makes it again
                continue
            # never a folder, and nothing outside of the take, whatever a record says
            if damage.file and path.is_file() and path.resolve().is_relative_to(take.root.resolve()):
                path.unlink()
            take.forget(damage.stage)
    arguments.result = checked.model_dump(mode="json")
    if arguments.json:
        return 1 if checked.damage else 0
    for damage in checked.damage:
        detail = f" ({damage.detail})" if damage.detail else ""
        say(f"{damage.problem}: {damage.file or f'results of the stage {damage.stage}'}{detail}")
    say(f"{counted(checked.files, 'file')} checked ({checked.bytes:,} bytes), {len(checked.damage) or 'none'} damaged")
    if checked.unchecked:
        say(f"not finished, so only partly checked: {', '.join(checked.unchecked)}")
    name = shlex.quote(str(folder))
    unmade = [damage.file for damage in checked.damage if not damage.stage]
    lost = sorted({file.split("/")[1] for file in unmade if file.startswith("bakes/")})
    if lost:
        names = " ".join(shlex.quote(str(take.bakes / bake)) for bake in lost)
        say(f"Damaged kept bakes are not made again by a run. To remove them: rm -r {names}")
    if own := [file for file in unmade if not file.startswith("bakes/")]:
        say(
            f"Not made by a run: {', '.join(own)}. Copy back a backup, or move what is damaged elsewhere to start over."
        )
    for line in dict.fromkeys(_assumed(take)):
        say(line)
    if any(damage.stage for damage in checked.damage):
        first = "" if arguments.remove else f"v3studio check {name} --remove && "
        say(f"To make them again: {first}v3studio run {name}")
    return 1 if checked.damage else 0


def _assumed(take: Take) -> list[str]:
    """Say how the take's footage and camera file are read, one sentence each."""
    from v3studio.pipelines.config import load_config
    from v3studio.pipelines.stages.inputs import Inputs
    from v3studio.pipelines.takes.results.stage_files import CamerasFromFile, read_cameras_report

    lines: list[str] = []
    try:
        report = read_cameras_report(take)
        if isinstance(report, CamerasFromFile):
            lines += [f"Cameras: {shown(report.file)}.", *report.notes]
        inputs = Inputs(take, load_config(take.config))
        opened = inputs.calibrated_footage if take.rig.is_file() else inputs.raw_footage
        lines += [*opened.description.splitlines(), *(f"Warning: {warning}" for warning in opened.warnings)]
    except StudioError as error:  # damage is reported above; footage may be elsewhere
        lines.append(f"Not known how the footage is read: {error}")
    return lines


def _check_stream(arguments: argparse.Namespace) -> int:
    from v3studio.pipelines.takes.results.videos import stream_place
    from v3studio.studio.stream import StreamReader, check_stream

    if arguments.remove:
        problem = "--remove is for takes, whose files can be made again; this is a stream"
        raise invalid_option("--remove", problem, "Leave it out, or name the folder of the take.", arguments.place)
    with working("check", arguments) as report, StreamReader.open(stream_place(arguments.place)) as reader:
        checked = check_stream(reader, report)
    arguments.result = asdict(checked)
    if arguments.json:
        return 1 if checked.damage else 0
    for damage in checked.damage:
        numbers = ", ".join(map(str, damage.groups))
        where = f" (group{'s' * (len(damage.groups) > 1)} {numbers})" if numbers else ""
        say(f"{damage.file}{where}: {damage.problem}")
    say(f"{counted(checked.files, 'file')} checked ({checked.bytes:,} bytes), {len(checked.damage) or 'none'} damaged")
    if checked.damage:
        say("To repair it: copy the stream again, or bake it again (v3studio bake TAKE --force).")
    return 1 if checked.damage else 0
