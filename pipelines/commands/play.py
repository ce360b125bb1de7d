"""`v3studio play`: plays a stream without a window and measures each frame."""

from __future__ import annotations

import argparse
import shlex
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from v3studio.pipelines.commands.common.arguments import add_command, add_frames, invalid_option
from v3studio.pipelines.reports.terminal import say
from v3studio.studio.errors import StudioError

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from v3studio.studio.playback import PlayedFrame
    from v3studio.studio.stream import StreamReader


_MOST_PIXELS = 1 << 26
"""Most pixels of an image of --render, whose size the stream says: 8192x8192. Each takes some 20 bytes of memory."""


def register(commands: Any) -> None:
    more = "Damaged groups are skipped and reported, with exit code 1. To watch a stream, use `v3studio open`."
    text = "decode a stream and measure the time and size of each frame"
    play = add_command(commands, "play", text, _play, more)
    play.add_argument("stream", metavar="STREAM", help="folder of a stream or a take, a .v3s file, or a URL")
    play.add_argument("--realtime", action="store_true", help="play at the stream's frame rate and drop late frames")
    play.add_argument("--render", action="store_true", help="also render each frame from the stream's suggested camera")
    add_frames(play, "play", steps=False)


def _play(arguments: argparse.Namespace) -> int:
    from v3studio.pipelines.reports.tables import print_playback
    from v3studio.pipelines.takes.results.videos import open_reader, stream_numbers
    from v3studio.studio.playback import play_headless

    start, stop, step = arguments.frames
    if step != 1:
        raise invalid_option("--frames", f"the step of --frames is {step}", "A player shows every frame: leave it out.")
    with open_reader(arguments.stream) as reader:
        numbers = stream_numbers(arguments.stream, reader)
        end = numbers.number(reader.frame_count - 1) if stop is None else stop - 1
        chosen = numbers.within(start or 0, end)
        if not chosen or chosen.start >= reader.frame_count:
            first, last = numbers.number(0), numbers.number(reader.frame_count - 1)
            problem = f"--frames {first if start is None else start}:{end + 1}: the stream has no such frames"
            raise invalid_option("--frames", problem, f"It has frames {first} to {last}.")
        report = play_headless(
            reader,
            realtime=arguments.realtime,
            start_frame=chosen.start,
            frame_limit=None if stop is None else len(chosen),
            on_frame=_renderer(reader, arguments.stream) if arguments.render else None,
        )
    warnings = [group.sentence(numbers.number) for group in report.skipped]
    frames = tuple(replace(row, frame=numbers.number(row.frame)) for row in report.frames)
    skipped = tuple(replace(group, first_frame=numbers.number(group.first_frame)) for group in report.skipped)
    report = replace(report, frames=frames, skipped=skipped)
    arguments.result = report.to_dict()
    if not arguments.json:
        print_playback(report)
        say(f"To watch it: v3studio-gui {shlex.quote(arguments.stream)}")
    for warning in warnings:
        say(f"warning: {warning}", error=True)
    return 1 if warnings else 0


def _renderer(reader: StreamReader, stream: str | Path) -> Callable[[PlayedFrame], object]:
    """Return a function that renders a frame and the set from the stream's suggested camera over its background."""
    from v3studio.pipelines.reports.images import render
    from v3studio.studio.stream import StreamMetadata

    metadata = StreamMetadata.from_json(reader.manifest.metadata)
    if metadata.suggested_camera is None:
        problem = "the stream has no suggested camera"
        raise StudioError("stream.no_camera", problem, file=stream, fix="Remove --render.", option="--render")
    camera = metadata.suggested_camera.undistorted()
    if camera.width * camera.height > _MOST_PIXELS:
        problem = (
            f"the suggested camera has {camera.width}x{camera.height} pixels; at most {_MOST_PIXELS:,} are rendered"
        )
        raise StudioError("stream.camera_too_large", problem, file=stream, fix="Remove --render.", option="--render")
    background = metadata.background or (0.0, 0.0, 0.0)
    behind = reader.set_splats()
    return lambda played: render(played.gaussians.before(behind), camera, background)
