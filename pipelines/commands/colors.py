"""`v3studio colors`: the colors of the cameras, from a ColorChecker in the footage."""

import argparse
from contextlib import closing
from typing import Any

from pipelines.commands.common.arguments import add_command, print_text
from pipelines.commands.common.source import add_source, read_settings


def register(commands: Any) -> None:
    more = (
        "Finds a ColorChecker Classic (24 patches) in the image of each camera, and shows how far the cameras' colors "
        "are apart before and after the correction that train.camera_colors makes."
    )
    command = add_command(commands, "colors", "compare the cameras' colors on a ColorChecker", _colors, more)
    add_source(command)
    command.add_argument(
        "--chart-frame",
        type=int,
        required=True,
        metavar="N",
        help="frame in which the cameras see the chart, as numbered in the files",
    )


def _colors(arguments: argparse.Namespace) -> int:
    from pipelines.commands.common.working import working
    from studio.capture import open_footage
    from studio.capture.color_chart import fit_chart_colors

    capture = read_settings(arguments.source, arguments.overrides).capture
    footage = open_footage(capture.replace(masks="none", audio=None), None, strict=False)
    with closing(footage), working("colors", arguments) as progress:
        fit = fit_chart_colors(footage, arguments.chart_frame, footage.train_cameras, progress)
    settings = {"train": {"camera_colors": fit.frame}}
    without = {name: error.problem for name, error in fit.without.items()}
    figures = {"before": fit.before, "after": fit.after, "without": without, "patches": fit.patches}
    arguments.result = {**figures, **settings}
    for name in footage.train_cameras:
        if name in fit.matrices:
            before, after = fit.before[name], fit.after[name]
            print_text(arguments, f"{name}: found, {before:.1f} levels of 255 from the mean camera, {after:.1f} after")
        else:
            print_text(arguments, f"{name}: {without[name]}; not corrected")
    found = f"{len(fit.matrices)} of {len(footage.train_cameras)} cameras, {fit.patches} of 24 patches"
    print_text(arguments, f"{found}. To correct them:\ntrain: {{camera_colors: {fit.frame}}}")
    return 0
