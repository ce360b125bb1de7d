"""`v3studio export`: a take's or a stream's frames in the formats of other programs, or as a movie."""

from __future__ import annotations

import argparse
import operator
import re
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from studio.errors import StudioError

if TYPE_CHECKING:
    from collections.abc import Callable

    from studio.cameras import Camera
    from studio.progress import ProgressFn
    from studio.splat_video import SplatVideo

FORMATS = {
    "ply": "a folder of numbered 3DGS PLY files (or one .ply file of one frame)",
    "spz": "the same as SPZ, a quarter of the size",
    "glb": "the same as GLB with KHR_gaussian_splatting",
    "videogs": "a folder in the layout that the players of the paper's released code read",
    "turntable": "an MP4 that circles the subject",
    "camera-path": "an MP4 along the cameras of --path",
}
DEFAULT_OF = "decoded"
"""What is exported of a take where nobody says: what a player shows. The window's dialog begins with it, too."""

_NOTE = "formats:\n" + "\n".join(f"  {name:12} {text}" for name, text in FORMATS.items())
_TURNTABLE_SECONDS = 6.0  # at least: faster makes dizzy


def register(commands: Any) -> None:
    """Add the command to the command line."""
    export = commands.add_parser(
        "export",
        help="write frames for other programs, or a movie",
        description="Write the frames of a take, a stream or an address for other programs, or draw a movie of them.",
        epilog=_NOTE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    export.add_argument("source", metavar="SOURCE", help="a take's folder, a stream's, or an http(s):// address")
    export.add_argument("--format", choices=list(FORMATS), required=True, metavar="FORMAT", help=", ".join(FORMATS))
    export.add_argument("--out", type=Path, required=True, metavar="PATH", help="what to write; must not exist yet")
    export.add_argument("--frames", metavar="A:B[:S]", help="frames A to B - 1, every S-th, counted from 0")
    export.add_argument(
        "--of",
        choices=("decoded", "trained"),
        help=f"of a take: what its stream decodes to, or the splats as trained (default: {DEFAULT_OF})",
    )
    export.add_argument(
        "--axes", choices=("world", "viewer"),
        help="ply, spz, glb: the capture's axes, or upright by the format's convention (default: world for ply)",
    )  # fmt: skip
    export.add_argument(
        "--sh-degree", type=int, choices=range(4), metavar="N", help="cut harmonics to this degree, 0 to 3"
    )
    export.add_argument("--qp", type=int, default=20, help="videogs: H.264's QP, 0 to 51, 0 is lossless (default: 20)")
    export.add_argument("--size", default="1280x720", metavar="WxH", help="movies: pixels (default: 1280x720)")
    export.add_argument("--seconds", type=float, help="movies: length (default: the path's, the video's)")
    export.add_argument("--fps", type=float, help="movies: frames a second (default: the video's)")
    export.add_argument("--crf", type=int, default=18, help="movies: x264's quality, 0 to 51 (default: 18)")
    export.add_argument("--background", metavar="R,G,B", help="movies: 0 to 1 each (default: the capture's)")
    export.add_argument("--path", type=Path, metavar="FILE", help="camera-path: cameras keyed in time, or a rig.json")
    export.add_argument("--turns", type=float, default=1.0, help="turntable: how often round (default: 1)")
    export.add_argument("--elevation", type=float, default=10.0, help="turntable: degrees above (default: 10)")
    export.add_argument("--json", action="store_true", help="print progress as JSON lines")
    export.set_defaults(command=_export)


def _export(arguments: argparse.Namespace) -> int:
    size = _size(arguments.size)
    if (arguments.path is not None) != (arguments.format == "camera-path"):
        raise StudioError("A camera path needs --path FILE, and no other format takes one.")
    from pipelines.commands.working import working
    from pipelines.takes.videos import decoded_video, is_take, open_reader, trained_video

    with ExitStack() as stack:
        if is_take(arguments.source) and (arguments.of or DEFAULT_OF) == "trained":
            video = trained_video(Path(arguments.source).expanduser())
        elif arguments.of == "trained":
            raise StudioError(f"{arguments.source}: only a take has trained splats; leave --of out.")
        else:
            _need_stream(arguments.source)
            video = decoded_video(stack.enter_context(open_reader(arguments.source)))
        video = _chosen(video, arguments.frames, arguments.sh_degree)
        json_output = arguments.output if arguments.json else None
        progress = stack.enter_context(working(f"export {arguments.format}", json_output))
        if arguments.format in ("turntable", "camera-path"):
            written = _movie(video, arguments, size, progress)
        else:
            written = _frames(video, arguments, progress)
    if not arguments.json:
        print(f"{written} in {arguments.out}")
    return 0


def _need_stream(source: str) -> None:
    from pipelines.takes.take import Take
    from pipelines.takes.videos import is_take

    if is_take(source) and not Take.open(Path(source).expanduser()).stream.is_dir():
        raise StudioError(
            f"{source}: this take has no stream yet; run `v3studio bake`, or export what is trained with --of trained."
        )


def _chosen(video: SplatVideo, text: str | None, sh_degree: int | None) -> SplatVideo:
    if sh_degree is not None:
        read, degree = video.read, sh_degree
        video = replace(video, read=lambda index: read(index).with_sh_degree(degree))
    if text is None:
        return video
    found = re.fullmatch(r"(\d*):(\d*)(?::(\d+))?", text)
    if found is None:
        raise StudioError(f"--frames is '{text}'; write A:B or A:B:S, as in 0:20 for frames 0 to 19.")
    start, stop, step = found.groups()
    return video.part(int(start or 0), int(stop) if stop else None, int(step or 1))


def _size(text: str) -> tuple[int, int]:
    found = re.fullmatch(r"(\d{1,5})x(\d{1,5})", text)
    if found is None:
        raise StudioError(f"--size is '{text}'; write WxH, as in 1280x720.")
    return int(found[1]), int(found[2])


def _frames(video: SplatVideo, arguments: argparse.Namespace, progress: ProgressFn) -> str:
    from studio.export import axes_of, export_frame, export_sequence, export_videogs

    out: Path = arguments.out
    if arguments.format == "videogs":
        if arguments.axes == "viewer":
            raise StudioError("The VideoGS layout keeps the capture's axes; leave --axes out.")
        export_videogs(video, out, qp=arguments.qp, progress=progress)
        return f"{video.frame_count} frames, {len(video.groups)} groups"
    ending = f".{arguments.format}"
    viewer = arguments.axes == "viewer" or (arguments.axes is None and arguments.format != "ply")
    rotation = axes_of(video, ending, viewer)
    if out.suffix.lower() != ending:
        export_sequence(video, out, ending, rotation, progress)
    elif video.frame_count == 1:
        export_frame(video, out, rotation)
    else:
        raise StudioError(
            f"{out}: {video.frame_count} frames need a folder; give a name without {ending}, or one frame with "
            "--frames, as in 0:1."
        )
    return f"{video.frame_count} frames"


def _movie(video: SplatVideo, arguments: argparse.Namespace, size: tuple[int, int], progress: ProgressFn) -> str:
    from studio.export import CameraPath, read_path_keys, render_movie, turntable

    if arguments.background is not None:
        video = replace(video, background=_color(arguments.background))

    camera: Callable[[float], Camera]
    frame: Callable[[float], float] = partial(operator.mul, video.fps)
    if arguments.format == "turntable":
        seconds = arguments.seconds or max(video.duration, _TURNTABLE_SECONDS)
        circling = turntable(video, *size, turns=arguments.turns, elevation=arguments.elevation)
        camera = lambda at: circling(at / seconds)  # noqa: E731
    else:
        keys = read_path_keys(arguments.path, arguments.seconds or video.duration)
        path = CameraPath(keys, *size)
        seconds = arguments.seconds or path.duration or video.duration
        camera = path.camera
        if path.has_frames:
            frame = path.frame
    count = render_movie(
        video, arguments.out, camera, frame, seconds, arguments.fps or video.fps, arguments.crf, progress
    )
    return f"{count} pictures of {size[0]}x{size[1]}"


def _color(text: str) -> tuple[float, float, float]:
    try:
        red, green, blue = (float(value) for value in text.split(","))
    except ValueError:
        raise StudioError(f"--background is '{text}'; write three numbers from 0 to 1, as in 1,1,1.") from None
    if not all(0 <= value <= 1 for value in (red, green, blue)):
        raise StudioError(f"--background is '{text}'; each number must be from 0 to 1.")
    return red, green, blue
