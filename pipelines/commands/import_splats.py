"""`v3studio import`: splats made by other programs, baked to a stream that can be played, served and compared."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from studio.errors import StudioError


def register(commands: Any) -> None:
    """Add the command to the command line."""
    parser = commands.add_parser(
        "import",
        help="bake splats of other programs to a stream",
        description="Bake a folder of numbered 3DGS PLY (or SPZ) files, one such file, or a folder in the VideoGS "
        "layout to a stream. Where the splats cannot be followed from one frame to the next, a new group begins.",
        epilog="--set bake.qp=22 or --bake.qp 22 overrides a setting of baking; `v3studio config` prints them.",
        allow_abbrev=False,
    )
    parser.add_argument("source", type=Path, metavar="SOURCE", help="folder or file to import")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="the stream's folder; must not exist")
    parser.add_argument("--fps", type=float, default=30.0, help="frames a second to play at (default: 30)")
    parser.add_argument("--group-size", type=int, default=20, metavar="N", help="frames a group at most (default: 20)")
    parser.add_argument("--up", metavar="X,Y,Z", help="what is up (default: as the format has it, 0,-1,0 for PLY)")
    parser.add_argument("--set", action="append", default=[], metavar="SECTION.NAME=VALUE", help="override a setting")
    parser.add_argument("--json", action="store_true", help="print progress as JSON lines")
    parser.set_defaults(command=_import)


def _import(arguments: argparse.Namespace) -> int:
    if not 0 < arguments.fps <= 1000:
        raise StudioError(f"--fps is {arguments.fps:g}; give frames a second above 0, up to 1000.")
    up = None if arguments.up is None else _vector(arguments.up)
    from dataclasses import replace

    import numpy as np

    from pipelines.commands.working import working
    from pipelines.config import load_config
    from studio.imports import open_import
    from studio.imports.baking import bake_video

    config = load_config(None, arguments.overrides)
    json_output = arguments.output if arguments.json else None
    with working("look", json_output) as progress:
        video = open_import(arguments.source, arguments.fps, progress)
    if up is not None:
        video = replace(video, up=np.array(up))
    with working("bake", json_output) as progress:
        manifest = bake_video(
            video, arguments.out, config.bake, arguments.group_size, progress, threads=config.run.threads
        )
    if not arguments.json:
        print(
            f"{manifest.frame_count} frames in {len(manifest.groups)} groups, {manifest.total_bytes:,} bytes, "
            f"in {arguments.out}"
        )
    return 0


def _vector(text: str) -> tuple[float, float, float]:
    try:
        x, y, z = (float(value) for value in text.split(","))
    except ValueError:
        raise StudioError(f"--up is '{text}'; write three numbers, as in 0,0,1.") from None
    length = (x * x + y * y + z * z) ** 0.5
    if not 0 < length < float("inf"):
        raise StudioError(f"--up is '{text}'; it must have a direction.")
    return x / length, y / length, z / length
