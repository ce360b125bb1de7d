"""`v3studio play`: a stream through the player's threads, without a window, and what each frame costs."""

from __future__ import annotations

import argparse
import sys
from typing import TYPE_CHECKING, Any

from studio.errors import StudioError

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from studio.cameras import Camera
    from studio.gaussians import Gaussians


def register(commands: Any) -> None:
    """Add the command to the command line."""
    play = commands.add_parser(
        "play",
        help="play a stream and tell what each frame costs",
        description="Play a stream from a folder or a web server and tell what each frame costs. Damaged groups are "
        "left out and named; the exit code is then 1.",
        allow_abbrev=False,
    )
    play.add_argument("stream", metavar="STREAM", help="a stream's folder, a take's, or an http(s):// address")
    play.add_argument("--headless", action="store_true", help="without a window: decode only, and print the times")
    play.add_argument("--realtime", action="store_true", help="at the stream's frame rate, leaving late frames out")
    play.add_argument("--draw", action="store_true", help="draw each frame from the stream's suggested camera, too")
    play.add_argument("--frames", type=int, metavar="N", help="stop after N frames")
    play.add_argument("--json", action="store_true", help="print JSON")
    play.set_defaults(command=_play)


def _play(arguments: argparse.Namespace) -> int:
    if not arguments.headless:
        raise StudioError("The command line plays without a window only: add --headless, or open v3studio-gui.")
    from pipelines.reports.tables import print_playback
    from pipelines.takes.locate_stream import stream_place
    from studio.playback import play_headless
    from studio.stream import StreamReader

    with StreamReader.open(stream_place(arguments.stream)) as reader:
        draw = _drawing(reader.manifest.metadata, arguments.stream) if arguments.draw else None
        report = play_headless(reader, realtime=arguments.realtime, frame_limit=arguments.frames, draw=draw)
    if arguments.json:
        import json

        print(json.dumps(report.to_dict(), indent=1), file=arguments.output)
    else:
        print_playback(report)
    for group in report.skipped:
        print(f"warning: {group}", file=sys.stderr)
    return 1 if report.skipped else 0


def _drawing(metadata: dict[str, Any], stream: str | Path) -> Callable[[Gaussians], object]:
    """Draws splats from the stream's suggested camera, over the background of its metadata."""
    from pipelines.reports.pictures import draw
    from studio.cameras import Camera

    values = metadata.get("suggested_camera")
    if not isinstance(values, dict):
        raise StudioError(f"{stream}: the stream suggests no camera to draw from; leave --draw out.")
    camera: Camera = Camera.from_dict(values).undistorted()
    background = metadata.get("background", (0.0, 0.0, 0.0))
    return lambda gaussians: draw(gaussians, camera, background)
