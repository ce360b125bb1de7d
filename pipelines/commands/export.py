"""`v3studio export`: writes frames of a take or a stream in other programs' formats, or rendered as EXR or a movie."""

import argparse
import re
from pathlib import Path
from typing import Any

from v3studio.pipelines.commands.common.arguments import add_command, add_frames, add_overwrite, three_numbers
from v3studio.pipelines.commands.common.working import say_note, working
from v3studio.pipelines.export import DEFAULT_OF
from v3studio.pipelines.reports.terminal import say
from v3studio.studio.capture.frame_range import ALL_FRAMES
from v3studio.studio.counts import counted
from v3studio.studio.formats import EXPORTS

_NOTE = "formats:\n" + "\n".join(f"  {name:12} {form.written}" for name, form in EXPORTS.items())

_WORLD = ", ".join(name for name, form in EXPORTS.items() if form.holds == "frame" and form.keeps_axes)


def register(commands: Any) -> None:
    text = "export frames as PLY, SPZ, GLB, USD, VideoGS or EXR, or as a movie"
    export = add_command(commands, "export", text, _export, epilog=_NOTE)
    export.add_argument("source", metavar="SOURCE", help="folder of a take or a stream, or an http(s):// URL")
    export.add_argument("--format", choices=list(EXPORTS), required=True, metavar="FORMAT", help=", ".join(EXPORTS))
    export.add_argument("--out", type=Path, required=True, metavar="PATH", help="file or folder")
    add_overwrite(export)
    add_frames(export, "export")
    export.add_argument(
        "--of",
        choices=("decoded", "trained", "set"),
        help=f"frames decoded from the stream, those of a take as trained, or the set (default: {DEFAULT_OF})",
    )
    export.add_argument(
        "--axes", choices=("world", "viewer"),
        help="files of splats, exr, and film tools' cameras in --path: axes of the capture (world), or upright by the "
        f"format's convention (viewer); default: world for {_WORLD}, viewer for the others",
    )  # fmt: skip
    export.add_argument(
        "--sh-degree", type=int, choices=range(4), metavar="N", help="truncate spherical harmonics to degree N, 0 to 3"
    )
    for form in EXPORTS.values():
        for name, option in form.arguments.items():
            option_help = f"{form.name}: {option.help}"
            argument = f"--{name.replace('_', '-')}"
            export.add_argument(argument, type=option.kind, choices=option.choices, help=option_help)
    export.add_argument("--qp", type=int, help="videogs: QP of H.264, 0 (lossless) to 51 (default: 22)")
    export.add_argument(
        "--size",
        type=_size,
        metavar="WxH",
        help="movies, exr: size in pixels (default: 1280x720, or that of the footage camera)",
    )
    export.add_argument("--seconds", type=float, help="movies: duration (default: that of the path or the source)")
    export.add_argument("--fps", type=float, help="movies: frames per second (default: that of the source)")
    export.add_argument("--crf", type=int, help="movies: CRF of x264, 0 to 51 (default: 18)")
    export.add_argument(
        "--background",
        type=_color,
        metavar="R,G,B",
        help="movies: 0 to 1 each, in place of the set (default: that of the source)",
    )
    export.add_argument(
        "--path", type=Path, metavar="FILE",
        help="camera-path, exr: camera keyframes, a rig.json, or a camera of a USD or Nuke (.nk) file",
    )  # fmt: skip
    export.add_argument("--camera", metavar="NAME", help="exr: camera of the footage; with --path, camera of that file")
    export.add_argument(
        "--start-number", type=int, metavar="N",
        help="usd, exr, and film tools' cameras in --path: number of the first frame (default: that in the footage)",
    )  # fmt: skip
    export.add_argument(
        "--color-space", choices=("acescg", "rec709", "srgb"),
        help="exr: scene-linear ACEScg (default) or Rec.709, or sRGB values as trained",
    )  # fmt: skip
    export.add_argument("--overscan", type=int, metavar="PIXELS", help="exr: pixels added on each side (default: 0)")
    export.add_argument(
        "--shutter", type=float, metavar="DEGREES",
        help="exr: angle of the shutter for motion blur, 0 (default: none) to 360",
    )  # fmt: skip
    export.add_argument(
        "--shutter-samples", type=int, metavar="N", help="exr: rendered instants per frame (default: 16)"
    )
    export.add_argument(
        "--mattes", type=int, metavar="N", help="exr: mattes of N performers who stand apart (default: none)"
    )
    export.add_argument(
        "--deep",
        type=int,
        metavar="N",
        help="exr: also deep files, at most N samples per pixel (default: none)",
    )
    export.add_argument("--turns", type=float, help="turntable: number of turns (default: 1)")
    export.add_argument("--elevation", type=float, help="turntable: elevation in degrees (default: 10)")


def _export(arguments: argparse.Namespace) -> None:
    from v3studio.pipelines.export.source import Source
    from v3studio.pipelines.export.writers import OPTIONS, writer_of

    place, name, out = arguments.source, arguments.format, arguments.out
    given = {option: getattr(arguments, option) for option in OPTIONS}
    options = {option: value for option, value in given.items() if value not in (None, ALL_FRAMES)}
    with Source(place) as source, working(f"export {name}", arguments) as progress:
        written = writer_of(name, source, out, arguments.overwrite, options).write(progress)
    if not arguments.json:
        say(f"{out}: {counted(written.frames, 'frame')}{written.more}")
    for note in filter(None, written.notes):
        say_note(arguments, note)
    arguments.result = {"path": str(out.absolute()), "format": name, "frames": written.frames}
    if written.bytes is not None:
        arguments.result["bytes"] = written.bytes


def _size(text: str) -> tuple[int, int]:
    size = re.fullmatch(r"([1-9]\d{0,4})x([1-9]\d{0,4})", text)
    if size is None:
        raise argparse.ArgumentTypeError(f"'{text}' is not of the form WxH; example: 1280x720")
    return int(size[1]), int(size[2])


def _color(text: str) -> tuple[float, float, float]:
    color = three_numbers(text)
    if not all(0 <= value <= 1 for value in color):
        raise argparse.ArgumentTypeError(f"'{text}' is not three numbers from 0 to 1; example: 1,1,1")
    return color
