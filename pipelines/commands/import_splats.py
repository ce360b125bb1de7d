"""`v3studio import`: bakes Gaussians from other programs into a stream."""

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

from v3studio.pipelines.commands.common.arguments import (
    add_command,
    add_overwrite,
    add_settings,
    invalid_option,
    three_numbers,
)
from v3studio.pipelines.commands.common.working import say_note, working
from v3studio.pipelines.outputs import replacing
from v3studio.pipelines.reports.terminal import say
from v3studio.studio.counts import counted
from v3studio.studio.errors import StudioError


def register(commands: Any) -> None:
    text = "bake splat files from other programs into a stream: PLY, SPZ, SOG, .splat, USD"
    more = (
        "SOURCE is a folder of numbered splat files of one format, one such file, or a USD file. Formats: 3DGS PLY and "
        "compressed PLY, SPZ (versions 2 to 4), SOG (.sog, or meta.json with its images) and .splat. A new group "
        "begins where Gaussians do not correspond to those of the previous frame."
    )
    parser = add_command(commands, "import", text, _import, more)
    parser.add_argument("source", type=Path, metavar="SOURCE", help="folder or file to import")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder of the stream")
    add_overwrite(parser)
    parser.add_argument("--fps", type=float, help="frames per second (default: that of a USD file; 30 for others)")
    parser.add_argument(
        "--group-size", type=int, metavar="N", help="maximum frames per group (default: train.group_size)"
    )
    parser.add_argument(
        "--up",
        type=_direction,
        metavar="X,Y,Z",
        help="up direction (default: what the file says; otherwise 0,1,0 for SPZ, 0,-1,0 for others)",
    )
    add_settings(parser)


def _import(arguments: argparse.Namespace) -> None:
    if arguments.fps is not None and not 0 < arguments.fps <= 1000:
        problem = f"--fps {arguments.fps:g} is not between 0 and 1000 frames per second"
        raise invalid_option("--fps", problem, "Example: 30.", arguments.fps)
    import numpy as np

    from v3studio.pipelines.config import load_config
    from v3studio.studio.formats.baking import bake_video
    from v3studio.studio.formats.sequence import open_import

    _refuse_unused(arguments.overrides)
    config = load_config(None, arguments.overrides)
    with working("read", arguments) as progress:
        video = open_import(arguments.source, arguments.fps, progress)
    for note in video.notes:
        say_note(arguments, note)
    if arguments.up is not None:
        video = replace(video, up=np.array(arguments.up))
    elif video.up is not None:
        say_note(arguments, f"up is {','.join(f'{value:g}' for value in video.up)} (--up overrides it)")
    replaced = replacing(arguments.out, arguments.overwrite, lambda out: (out / "manifest.json").is_file())
    with replaced, working("bake", arguments) as progress:
        size = config.train.group_size if arguments.group_size is None else arguments.group_size
        manifest = bake_video(video, arguments.out, config.bake, size, progress, threads=config.run.thread_count)
    arguments.result = {
        "path": str(arguments.out.absolute()),
        "frames": manifest.frame_count,
        "groups": len(manifest.frame_counts),
        "bytes": manifest.total_bytes,
    }
    if not arguments.json:
        frames, groups = counted(manifest.frame_count, "frame"), counted(len(manifest.frame_counts), "group")
        say(f"{arguments.out}: {frames} in {groups}, {manifest.total_bytes:,} bytes")


def _refuse_unused(overrides: list[tuple[str, Any]]) -> None:
    from v3studio.pipelines.config import Config
    from v3studio.studio.settings import COMMAND_LINE, affected

    results = affected(Config)
    used = ["train.group_size", "run.threads", *(name for name, made in results.items() if "videos" in made)]
    for name, value in overrides:
        if name in results and name not in used:
            problem, fix = f"{name} has no effect on an import", f"Leave it out. These have one: {', '.join(used)}."
            raise StudioError("import.setting_not_used", problem, file=COMMAND_LINE, value=value, fix=fix, setting=name)


def _direction(text: str) -> tuple[float, float, float]:
    x, y, z = three_numbers(text)
    length = (x * x + y * y + z * z) ** 0.5
    if not 0 < length < float("inf"):
        raise argparse.ArgumentTypeError(f"'{text}' is not a direction X,Y,Z; example: 0,0,1")
    return x / length, y / length, z / length
