"""`v3studio board` and `sync`: preparing a capture."""

import argparse
from contextlib import closing
from pathlib import Path
from typing import Any

from v3studio.pipelines.commands.common.arguments import add_command, invalid_option, print_text
from v3studio.pipelines.commands.common.source import add_source, read_settings
from v3studio.pipelines.reports.terminal import say


def register(commands: Any) -> None:
    more = "Print it at 100%. The settings that describe it are printed."
    board = add_command(commands, "board", "write a calibration target to print, as PDF", _board, more)
    board.add_argument("file", type=Path, metavar="FILE.pdf", help="file to write")
    board.add_argument(
        "--kind", choices=("charuco", "chessboard"), default="charuco", help="pattern (default: charuco)"
    )
    board.add_argument("--columns", type=int, default=8, metavar="N", help="squares per row (default: 8)")
    board.add_argument("--rows", type=int, default=5, metavar="N", help="rows of squares (default: 5)")
    board.add_argument("--square", type=float, default=60.0, metavar="MM", help="side of a square in mm (default: 60)")
    board.add_argument(
        "--dictionary", default="DICT_4X4_50", metavar="NAME", help="marker dictionary (default: DICT_4X4_50)"
    )
    board.add_argument(
        "--paper",
        default="fit",
        metavar="NAME",
        help="paper size: a4, a3, a2, a1, a0, letter, tabloid, or fit, the size of the target (default: fit)",
    )

    text = "estimate time offsets between cameras"
    sync = add_command(commands, "sync", text, _sync, "Compares sound or motion, or reads timecodes.")
    add_source(sync)
    sync.add_argument(
        "--method",
        choices=("auto", "sound", "motion", "timecode"),
        default="auto",
        help="what to compare (default: auto, which is sound or else motion)",
    )
    sync.add_argument("--seconds", type=float, default=1.0, metavar="S", help="largest offset in seconds (default: 1)")


def _board(arguments: argparse.Namespace) -> None:
    from pydantic import ValidationError

    from v3studio.studio.calibration import CalibrationTarget, write_target_pdf
    from v3studio.studio.settings import COMMAND_LINE, refused
    from v3studio.studio.yaml_text import dump_yaml

    if arguments.file.suffix.lower() != ".pdf":
        raise invalid_option(
            "FILE.pdf", "the target is written as PDF", "Specify a file name that ends in .pdf.", file=arguments.file
        )
    # checked here in millimeters, as on the command line; `CalibrationTarget` uses meters
    if not 0 < arguments.square < 10_000:
        problem = f"--square {arguments.square:g} is not between 0 and 10000 mm"
        fix = "Specify the side of a square in millimeters; example: 60."
        raise invalid_option("--square", problem, fix, arguments.square)
    try:
        given = {name: getattr(arguments, name) for name in ("kind", "columns", "rows", "dictionary")}
        lengths = {"square": arguments.square / 1000, "marker": 0.75 * arguments.square / 1000}
        target = CalibrationTarget.model_validate(given | lengths)
    except ValidationError as error:
        raise refused(error, CalibrationTarget, COMMAND_LINE) from None
    width, height = write_target_pdf(target, arguments.file, paper=arguments.paper)
    names = ["kind", "columns", "rows", "square"]
    names += ["marker", "dictionary"] if target.kind == "charuco" else []
    settings = {"calibrate": {"board": {name: getattr(target, name) for name in names}}}
    arguments.result = {"path": str(arguments.file.absolute()), "width": width, "height": height, **settings}
    print_text(
        arguments,
        f"{arguments.file}: {width:g} x {height:g} mm. Print at 100%, measure a square, and use these settings with "
        f"the measured size:\n{dump_yaml(settings).rstrip()}",
    )


def _sync(arguments: argparse.Namespace) -> None:
    from v3studio.studio.footage import open_footage, refuse_unknown_cameras
    from v3studio.studio.footage.sync import check_sync

    capture = read_settings(arguments.source, arguments.overrides).capture
    with closing(open_footage(capture.replace(offsets={}, masks="none"), None, strict=False)) as footage:
        # configured offsets are ignored here, but their camera names are checked
        refuse_unknown_cameras(tuple(capture.offsets), footage.camera_names, "capture.offsets")
        report = check_sync(footage, method=arguments.method, seconds=arguments.seconds)
    if arguments.json:
        names = ("method", "offsets", "confidence", "timecodes", "whole")
        arguments.result = {name: getattr(report, name) for name in names} | {
            "unsure": list(report.unsure),
            "several": {name: list(fitting) for name, fitting in report.several.items()},
        }
        return
    for name, offset in report.offsets.items():
        if report.method == "timecode":
            say(f"{name}: {offset:+.0f} frames (timecode {report.timecodes[name]})")
        else:
            say(f"{name}: {offset:+.2f} frames (correlation {report.confidence[name]:.2f})")
    for warning in report.warnings():
        say(str(warning))
    if not report.warnings():
        say(f"All cameras are within half a frame of each other (method: {report.method}).")
    elif report.whole:
        words = ", ".join(f"{name}: {offset}" for name, offset in report.whole.items())
        say(f"capture: {{offsets: {{{words}}}}}")
