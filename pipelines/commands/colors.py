"""`v3studio colors`: the colors of the cameras, from a ColorChecker in the footage."""

import argparse
from typing import Any

from pipelines.commands.common.source import add_source, read_settings


def register(commands: Any) -> None:
    command = commands.add_parser(
        "colors",
        help="compare the cameras' colors on a ColorChecker",
        description="Find a ColorChecker Classic (24 patches) in the image of each camera, and show how far the "
        "cameras' colors are apart before and after the correction that train.camera_colors makes.",
    )
    add_source(command)
    command.add_argument(
        "--chart-frame",
        type=int,
        required=True,
        metavar="N",
        help="frame in which the cameras see the chart, as numbered in the files",
    )
    command.set_defaults(command=_colors)


def _colors(arguments: argparse.Namespace) -> int:
    from pipelines.commands.common.working import working
    from studio.capture import open_footage
    from studio.capture.color_chart import fit_chart_colors

    capture = read_settings(arguments.source, arguments.overrides).capture
    footage = open_footage(capture.replace(masks="none", audio=None), None, strict=False)
    try:
        with working("colors", None) as progress:
            fit = fit_chart_colors(footage, arguments.chart_frame, footage.train_cameras, progress)
    finally:
        footage.close()
    for name in footage.train_cameras:
        if name in fit.matrices:
            print(
                f"{name}: found, {fit.before[name]:.1f} levels of 255 from the mean camera, {fit.after[name]:.1f} after"
            )
        else:
            print(f"{name}: {fit.without[name].problem}; not corrected")
    print(f"{len(fit.matrices)} of {len(footage.train_cameras)} cameras, {fit.patches} of 24 patches. To correct them:")
    print(f"train: {{camera_colors: {fit.frame}}}")
    return 0
