"""`v3studio export`: writes frames of a take or a stream in other programs' formats, or rendered as EXR or a movie."""

from __future__ import annotations

import argparse
import operator
import re
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from v3studio.pipelines.commands.common.arguments import (
    ALL_FRAMES,
    add_command,
    add_frames,
    add_overwrite,
    invalid_option,
    three_numbers,
)
from v3studio.pipelines.commands.common.working import say_note, working
from v3studio.pipelines.outputs import replacing
from v3studio.pipelines.reports.terminal import say
from v3studio.studio.counts import counted
from v3studio.studio.errors import StudioError, naming
from v3studio.studio.formats import EXPORTS, USD_SUFFIXES

if TYPE_CHECKING:
    from collections.abc import Callable

    from v3studio.studio.audio import Pcm
    from v3studio.studio.cameras import Camera
    from v3studio.studio.formats.camera_path import Key
    from v3studio.studio.gaussians import Gaussians
    from v3studio.studio.progress import ProgressFn
    from v3studio.studio.splat_video import SplatVideo

DEFAULT_OF = "decoded"
"""Which frames of a take are exported by default: those that a player shows. Also the default in the window."""

_NOTE = "formats:\n" + "\n".join(f"  {name:12} {one.written}" for name, one in EXPORTS.items())
_SIZE = (1280, 720)
_TURNTABLE_SECONDS = 6.0  # shortest turn; a faster one is hard to watch


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
        choices=("decoded", "trained"),
        help=f"of a take: frames decoded from its stream, or as trained (default: {DEFAULT_OF})",
    )
    export.add_argument(
        "--axes", choices=("world", "viewer"),
        help="ply, spz, glb, usd, exr, and film tools' cameras in --path: axes of the capture (world), or upright by "
        "the format's convention (viewer); default: world for ply, viewer for the others",
    )  # fmt: skip
    export.add_argument(
        "--sh-degree", type=int, choices=range(4), metavar="N", help="truncate spherical harmonics to degree N, 0 to 3"
    )
    export.add_argument(
        "--spz-version", type=int, choices=(3, 4), help="spz: 4 (default), or 3 for viewers that cannot read 4"
    )
    export.add_argument("--qp", type=int, default=22, help="videogs: QP of H.264, 0 (lossless) to 51 (default: 22)")
    export.add_argument(
        "--size",
        type=_size,
        metavar="WxH",
        help="movies, exr: size in pixels (default: 1280x720, or that of the footage camera)",
    )
    export.add_argument("--seconds", type=float, help="movies: duration (default: that of the path or the source)")
    export.add_argument("--fps", type=float, help="movies: frames per second (default: that of the source)")
    export.add_argument("--crf", type=int, default=18, help="movies: CRF of x264, 0 to 51 (default: 18)")
    export.add_argument(
        "--background", type=_color, metavar="R,G,B", help="movies: 0 to 1 each (default: that of the source)"
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
        "--color-space", choices=("acescg", "rec709", "srgb"), default="acescg",
        help="exr: scene-linear ACEScg (default) or Rec.709, or sRGB values as trained",
    )  # fmt: skip
    export.add_argument(
        "--overscan", type=int, default=0, metavar="PIXELS", help="exr: pixels added on each side (default: 0)"
    )
    export.add_argument(
        "--shutter", type=float, default=0.0, metavar="DEGREES",
        help="exr: angle of the shutter for motion blur, 0 (default: none) to 360",
    )  # fmt: skip
    export.add_argument(
        "--shutter-samples", type=int, default=16, metavar="N", help="exr: rendered instants per frame (default: 16)"
    )
    export.add_argument(
        "--mattes", type=int, default=0, metavar="N", help="exr: mattes of N performers who stand apart (default: none)"
    )
    export.add_argument(
        "--deep",
        type=int,
        default=0,
        metavar="N",
        help="exr: also deep files, at most N samples per pixel (default: none)",
    )
    export.add_argument("--turns", type=float, default=1.0, help="turntable: number of turns (default: 1)")
    export.add_argument("--elevation", type=float, default=10.0, help="turntable: elevation in degrees (default: 10)")


def _export(arguments: argparse.Namespace) -> None:
    size = arguments.size or _SIZE
    if arguments.spz_version is not None and arguments.format != "spz":
        problem = f"--format {arguments.format} has no --spz-version"
        raise invalid_option("--spz-version", problem, "Remove --spz-version.", arguments.spz_version)
    _check_path(arguments)
    from v3studio.pipelines.takes.results.videos import (
        decoded_video,
        is_take,
        open_reader,
        stream_numbers,
        trained_video,
    )

    if EXPORTS[arguments.format].holds == "stream":
        _whole_stream(arguments)
        return

    with ExitStack() as stack:
        if is_take(arguments.source) and (arguments.of or DEFAULT_OF) == "trained":
            video = trained_video(Path(arguments.source).expanduser())
        elif arguments.of == "trained":
            raise invalid_option("--of", "--of trained needs a take", "Remove --of.", "trained", file=arguments.source)
        else:
            _need_stream(arguments.source)
            reader = stack.enter_context(open_reader(arguments.source))
            video = replace(decoded_video(reader), numbers=stream_numbers(arguments.source, reader).known)
        holds = EXPORTS[arguments.format].holds
        if holds == "movie" or arguments.format == "usd":
            video = replace(video, sound=_sound(arguments, stack, video))
        video = _chosen(video, arguments.frames, arguments.sh_degree)
        stack.enter_context(replacing(arguments.out, arguments.overwrite, partial(_is_export, arguments.format)))
        notes: list[str] = []
        progress = stack.enter_context(working(f"export {arguments.format}", arguments))
        if holds == "movie":
            count, more = _movie(video, arguments, size, progress)
        elif holds == "plates":
            count, more = _plates(video, arguments, size, progress)
        else:
            seen: set[float] = set()
            noting = _noting_dilations(video, seen)
            write = _usd if arguments.format == "usd" else _frames
            count, more = video.frame_count, write(noting, arguments, progress)
            notes = [_dilation_note(seen), _place_note(video, arguments)]
    if not arguments.json:
        say(f"{arguments.out}: {counted(count, 'frame')}{more}")
    for note in filter(None, notes):
        say_note(arguments, note)
    arguments.result = {"path": str(arguments.out.absolute()), "format": arguments.format, "frames": count}


def _check_path(arguments: argparse.Namespace) -> None:
    """Whether the format takes the options that say where the camera is."""
    follows = EXPORTS[arguments.format].follows_path
    if arguments.path is not None and not follows:
        raise invalid_option("--path", f"--format {arguments.format} does not take --path", "Remove --path.")
    if follows and arguments.path is None and (arguments.format != "exr" or arguments.camera is None):
        other = " or --camera NAME" if arguments.format == "exr" else ""
        raise invalid_option(
            "--path", f"--format {arguments.format} needs --path FILE{other}", f"Add --path FILE{other}."
        )
    if arguments.camera is not None and not follows:
        raise invalid_option(
            "--camera", f"--format {arguments.format} does not take --camera", "Remove --camera.", arguments.camera
        )


def _is_export(name: str, out: Path) -> bool:
    """Whether a file or folder may be an earlier export in this format: a folder holds nothing else."""
    if name == "videogs":
        from v3studio.studio.formats.videogs import is_videogs

        return is_videogs(out)
    files = [out] if out.is_file() else [path for path in out.rglob("*") if not path.is_dir()]
    suffixes = USD_SUFFIXES if name == "usd" else (EXPORTS[name].suffix,)
    return all(path.suffix.lower() in suffixes for path in files)


def _place_note(video: SplatVideo, arguments: argparse.Namespace) -> str:
    """Which world the files have, if it is not that of the splats; "" otherwise."""
    if video.original.is_identity:
        return ""
    scale = f"in the original units (1 of them is {1 / video.original.scale:g} of the stream's)"
    if not video.original.translation.any():
        return scale
    if _for_viewers(arguments):
        return f"{scale}, near zero; with --axes world, at the original place"
    doubles = ", with positions as doubles" if arguments.format == "ply" else ""
    return f"{scale}, at the original place{doubles}"


def _for_viewers(arguments: argparse.Namespace) -> bool:
    """Whether the splats are rotated to the axes of viewers."""
    chosen = EXPORTS[arguments.format]
    return bool(arguments.axes == "viewer" or (arguments.axes is None and not chosen.keeps_axes))


def _noting_dilations(video: SplatVideo, seen: set[float]) -> SplatVideo:
    """The same video, which adds the dilations of the frames that are read to `seen`."""

    def read(index: int) -> Gaussians:
        gaussians = video.read(index)
        seen.add(gaussians.dilation)
        return gaussians

    return replace(video, read=read)


def _dilation_note(seen: set[float]) -> str:
    """What to report of frames with these dilations that other programs draw; "" if they draw them as trained."""
    from v3studio.studio.dilation import DILATION

    found = sorted(seen - {DILATION})
    if not found:
        return ""
    trained = " and ".join(f"{one:g}" for one in found)
    look = "bolder and softer" if max(found) < DILATION else "thinner" if min(found) > DILATION else "bolder or thinner"
    return (
        f"viewers of these files assume a dilation of {DILATION:g} square pixels; the splats were trained with "
        f"{trained} and look {look} there"
    )


def _whole_stream(arguments: argparse.Namespace) -> None:
    from v3studio.pipelines.takes.results.videos import open_reader
    from v3studio.studio.formats.placing import new_file
    from v3studio.studio.stream.sources.archive import SUFFIX
    from v3studio.studio.stream.write_archive import write_archive

    for option in ("frames", "of", "sh_degree"):
        if getattr(arguments, option) not in (None, "decoded", ALL_FRAMES):
            name = f"--{option.replace('_', '-')}"
            problem = f"--format v3 has no {name}: the stream is written as it is"
            raise invalid_option(name, problem, f"Remove {name}.", getattr(arguments, option))
    if arguments.out.suffix.lower() != SUFFIX:
        problem = f"--format v3 writes a {SUFFIX} file"
        fix = f"End the name with {SUFFIX}, by which players recognize it."
        raise invalid_option("--out", problem, fix, arguments.out.suffix, file=arguments.out)
    _need_stream(arguments.source)
    replaced = replacing(arguments.out, arguments.overwrite, Path.is_file)
    with open_reader(arguments.source) as reader, replaced, new_file(arguments.out) as temporary:
        with working("export v3", arguments) as progress:
            size = write_archive(reader, temporary, progress)
        frames = reader.frame_count
    if not arguments.json:
        say(f"{arguments.out}: {counted(frames, 'frame')}, {size:,} bytes")
    arguments.result = {"path": str(arguments.out.absolute()), "format": "v3", "frames": frames, "bytes": size}


def _need_stream(source: str) -> None:
    from v3studio.pipelines.takes.results.videos import is_take
    from v3studio.pipelines.takes.take import Take

    if is_take(source) and not Take.open(Path(source).expanduser()).has_stream:
        fix = "Run `v3studio bake`, or export trained frames with --of trained."
        raise StudioError("take.no_stream", "this take has no stream yet", file=source, fix=fix, stage="bake")


def _sound(arguments: argparse.Namespace, stack: ExitStack, video: SplatVideo) -> Pcm | None:
    """The sound of the source's stream, also for trained frames; None if it has none, or was baked for later frames."""
    from v3studio.pipelines.takes.frames.frame_numbers import trained_numbers
    from v3studio.pipelines.takes.results.videos import capture_place, is_take, open_reader
    from v3studio.pipelines.takes.take import Take
    from v3studio.studio.audio.pcm import part_of

    source = arguments.source
    if is_take(source) and not Take.open(Path(source).expanduser()).has_stream:
        return None
    reader = stack.enter_context(open_reader(source))
    sound = reader.sound()
    if sound is None:
        return None
    stack.callback(sound.close)
    if arguments.of != "trained":
        return sound
    trained = trained_numbers(Take.open(Path(source).expanduser()))
    early = (trained.index(video.number(0)) or 0) - capture_place(reader).first_frame
    if early == 0 and video.frame_count == reader.frame_count:
        return sound
    return None if early < 0 else part_of(sound, early / video.fps, video.duration)


def _chosen(video: SplatVideo, frames: tuple[int | None, int | None, int], sh_degree: int | None) -> SplatVideo:
    if sh_degree is not None:
        read, degree = video.read, sh_degree
        video = replace(video, read=lambda index: read(index).with_sh_degree(degree))
    return video if frames == ALL_FRAMES else video.part(*frames)


def _size(text: str) -> tuple[int, int]:
    found = re.fullmatch(r"([1-9]\d{0,4})x([1-9]\d{0,4})", text)
    if found is None:
        raise argparse.ArgumentTypeError(f"'{text}' is not of the form WxH; example: 1280x720")
    return int(found[1]), int(found[2])


def _frames(video: SplatVideo, arguments: argparse.Namespace, progress: ProgressFn) -> str:
    from v3studio.studio.formats.sequence import axes_of, export_frame, export_sequence
    from v3studio.studio.formats.videogs import export_videogs

    out: Path = arguments.out
    if arguments.format == "videogs":
        if arguments.axes == "viewer":
            problem = "--axes viewer: the VideoGS layout supports only the axes of the capture"
            raise invalid_option("--axes", problem, "Remove --axes.", "viewer")
        export_videogs(video, out, qp=arguments.qp, progress=progress)
        return f", {counted(len(video.groups), 'group')}"
    chosen = EXPORTS[arguments.format]
    rotation = axes_of(video, chosen.up, _for_viewers(arguments))
    options = {} if arguments.spz_version is None else {"version": arguments.spz_version}
    if out.suffix.lower() != chosen.suffix:
        export_sequence(video, out, chosen.suffix, rotation, progress, **options)
    elif video.frame_count == 1:
        export_frame(video, out, rotation, **options)
    else:
        first = video.number(0)
        problem = f"{video.frame_count} frames cannot be written to one file"
        fix = (
            f"Specify a folder, a name without {chosen.suffix}, or select one frame with --frames {first}:{first + 1}."
        )
        raise invalid_option("--out", problem, fix, video.frame_count, file=out)
    return ""


def _usd(video: SplatVideo, arguments: argparse.Namespace, progress: ProgressFn) -> str:
    from v3studio.pipelines.takes.results.videos import footage_cameras
    from v3studio.studio.formats.sequence import axes_of
    from v3studio.studio.formats.usd import export_usd

    out: Path = arguments.out
    rotation = axes_of(video, EXPORTS["usd"].up, _for_viewers(arguments))
    cameras = footage_cameras(arguments.source, decoded=arguments.of != "trained")
    video = replace(video, numbers=_numbers(video, arguments))
    with ExitStack() as stack:
        if video.sound is not None and out.suffix.lower() != ".usdz":
            stack.enter_context(replacing(out.with_suffix(".wav"), arguments.overwrite, Path.is_file))
        export_usd(video, out, rotation, cameras, progress)
    cameras_too = f", {counted(len(cameras), 'camera')}" if cameras else ""
    return f", {counted(len(video.groups), 'group')}{cameras_too}{', sound' if video.sound is not None else ''}"


def _movie(
    video: SplatVideo, arguments: argparse.Namespace, size: tuple[int, int], progress: ProgressFn
) -> tuple[int, str]:
    from v3studio.studio.formats.camera_path import FILM_FORMATS, CameraPath, turntable
    from v3studio.studio.formats.movie import movie_sound, render_movie

    if arguments.background is not None:
        video = replace(video, background=arguments.background)

    camera: Callable[[float], Camera]
    frame: Callable[[float], float] = partial(operator.mul, video.fps)
    if arguments.format == "turntable":
        seconds = max(video.duration, _TURNTABLE_SECONDS) if arguments.seconds is None else arguments.seconds
        circling = turntable(video, *size, turns=arguments.turns, elevation=arguments.elevation)
        camera = lambda at: circling(at / seconds)  # noqa: E731
    else:
        with naming(arguments.path):
            keys = _keys(video, arguments, size)
            film = arguments.path.suffix.lower() in FILM_FORMATS and len(keys) > 1
            if film:  # its camera may move before and after the video
                keys = [key for key in keys if key.frame is not None and 0 <= key.frame < video.frame_count]
            path = CameraPath(keys, *size)
        usual = (path.duration + 1 / video.fps if film else path.duration) or video.duration
        seconds = usual if arguments.seconds is None else arguments.seconds
        camera = path.camera
        if path.has_frames:
            frame = path.frame
    fps = video.fps if arguments.fps is None else arguments.fps
    count = render_movie(video, arguments.out, camera, frame, seconds, fps, arguments.crf, progress)
    sound, why = movie_sound(video, frame, seconds, fps)
    heard = ", with sound" if sound is not None else f", without sound: {why}" if why else ""
    return count, f" of {size[0]}x{size[1]}{heard}"


def _keys(video: SplatVideo, arguments: argparse.Namespace, size: tuple[int, int]) -> list[Key]:
    """The keys of the camera path in the world of the splats."""
    from v3studio.pipelines.takes.authored.camera_paths import path_keys

    return path_keys(
        video,
        arguments.path,
        camera=arguments.camera,
        size=size,
        seconds=arguments.seconds,
        numbers=_numbers(video, arguments),
        upright=arguments.axes != "world",
    )


def _numbers(video: SplatVideo, arguments: argparse.Namespace) -> tuple[int, ...]:
    """Frame numbers for film tools."""
    first = arguments.start_number
    indices = range(video.frame_count)
    return tuple(video.number(index) if first is None else first + index for index in indices)


def _plates(
    video: SplatVideo, arguments: argparse.Namespace, size: tuple[int, int], progress: ProgressFn
) -> tuple[int, str]:
    from v3studio.pipelines.takes.authored.camera_paths import film_world
    from v3studio.pipelines.takes.results.videos import footage_cameras
    from v3studio.studio.cameras import Rig
    from v3studio.studio.formats.camera_path import CameraPath, Key
    from v3studio.studio.formats.exr import export_exr
    from v3studio.studio.formats.plates import Shutter

    if arguments.path is None:
        rig = Rig(footage_cameras(arguments.source, decoded=arguments.of != "trained"))
        if not rig.cameras:
            problem = f"--camera {arguments.camera} needs a take with cameras"
            raise invalid_option("--camera", problem, "Add --path FILE.", arguments.camera, file=arguments.source)
        chosen = rig[arguments.camera]
        own = size if arguments.size else (chosen.width, chosen.height)
        label, path = chosen.name, CameraPath([Key(0.0, chosen)], *own)
    else:
        label = arguments.camera or arguments.path.stem
        with naming(arguments.path):
            path = CameraPath(_keys(video, arguments, size), *size)
            if path.has_frames:
                path.seconds_of(0)  # raises if frames do not ascend

    def camera(index: float) -> Camera:
        seconds = path.seconds_of(index) if path.has_frames else index / video.fps
        return replace(path.camera(seconds), name=label)

    written = export_exr(
        replace(video, numbers=_numbers(video, arguments)),
        arguments.out,
        camera,
        film_world(video, upright=arguments.axes != "world"),
        arguments.color_space,
        arguments.overscan,
        Shutter(arguments.shutter, arguments.shutter_samples),
        arguments.mattes,
        arguments.deep,
        progress,
    )
    return video.frame_count, f" of {camera(0).width}x{camera(0).height}, {written:,} bytes"


def _color(text: str) -> tuple[float, float, float]:
    color = three_numbers(text)
    if not all(0 <= value <= 1 for value in color):
        raise argparse.ArgumentTypeError(f"'{text}' is not three numbers from 0 to 1; example: 1,1,1")
    return color
