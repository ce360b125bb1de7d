"""Frame rate of the window while it plays a stream from disk and the view rotates.

    python benchmarks/playback_window.py TAKE [--splats 60000] [--seconds 10]

Bakes the take's trained frames, with splats duplicated to the given number, to a temporary stream (if a stream's folder
is given, it is played unchanged). Opens the real window and rotates the view at each tick. Frames are not cached
between loops, so every frame is decoded. Needs a display; without one, use `xvfb-run -s "-screen 0 1400x900x24"`.
"""

import argparse
import os
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from v3studio.gui.app import check_display
from v3studio.studio.errors import StudioError
from v3studio.studio.playback import PlayedFrame

TURN = 6.0  # drag in pixels that rotates the view at each tick


def bake(take: Path, splats: int, folder: Path) -> None:
    """Bake the take's first groups, with duplicated splats, to a stream of 30 frames per second."""
    from stream_speed import trained_group

    from v3studio.studio.stream import BakeSettings, GroupEntry, bake_group, write_manifest

    settings, first = BakeSettings(), 0
    entries: list[GroupEntry] = []
    while len(entries) < 3 and (frames := trained_group(take, len(entries), splats)):
        entries.append(bake_group(frames, folder, len(entries), first, settings))
        first += len(frames)
    if not entries:
        raise StudioError("benchmark.not_trained", "the take has no trained frames", file=take)
    write_manifest(folder, entries, 30.0, settings, {})


def play(place: Path, seconds: float, size: tuple[int, int], device: str) -> None:
    """Open the window, play and rotate the view, and print the frame rates."""
    from open3d.visualization import gui

    from v3studio.gui.models.playback.stream_source import StreamSource
    from v3studio.gui.window import MainWindow

    application = gui.Application.instance
    application.initialize()
    drawn = 0

    class CountingWindow(MainWindow):
        """Counts how often it is drawn."""

        def tick(self) -> bool:
            nonlocal drawn
            due = super().tick()
            drawn += due
            return due

    window = CountingWindow(size, None, device, device.endswith("(software)"))
    window.open(str(place))
    until = time.monotonic() + 60
    while window.player.picture is None:
        application.run_one_tick()
        if time.monotonic() > until:
            raise StudioError("benchmark.no_picture", f"no picture after a minute: {window.player.message}")
    player = window.player
    source = player.opened.sources["decoded"] if player.opened else None
    assert isinstance(source, StreamSource)
    frames_of, loads = source._frames, list[float]()
    frames_of._ready.limit = 0  # only keeps a few frames ahead
    get = frames_of.get

    def timed(frame: int) -> PlayedFrame:
        splats = get(frame)
        loads.append(splats.stats.decode_ms + splats.stats.dequantize_ms)
        return splats

    frames_of.get = timed  # type: ignore[assignment, method-assign]
    player.transport.play()
    frames: list[int] = []
    draws: list[float] = []
    ticks: list[float] = []
    shown = player.picture
    pictures = window.panels.viewport.pictures
    drawn_before = drawn
    cpu, start = time.process_time(), time.monotonic()
    last = start
    while time.monotonic() < start + seconds:
        player.drag(TURN, 0.0, True, player.size[1])
        application.run_one_tick()
        now = time.monotonic()
        ticks.append(now - last)
        last = now
        if player.picture is not shown and player.picture is not None:
            shown = player.picture
            frames.append(shown.request.frame)
            draws.append(shown.draw_seconds)
    elapsed, cpu = time.monotonic() - start, time.process_time() - cpu
    count = source.frame_count
    steps = np.diff(frames) % count
    backwards = int((steps > count - 6).sum())
    assert shown is not None
    made = window.panels.viewport.pictures - pictures
    print(f"{device}; {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}; {shown.splats:,} splats, {count} frames,")
    print(f"  picture {player.size[0]}x{player.size[1]} in a window of {size[0]}x{size[1]}, rotating at each tick")
    print(f"  delivered {made / elapsed:.1f} pictures/s; {backwards} of {len(steps)} frame steps backward")
    print(f"  window drawn {(drawn - drawn_before) / elapsed:.1f} times/s")
    print(f"  decode {np.median(loads):.1f} ms, draw {1e3 * np.median(draws):.1f} ms (medians of wall-clock time)")
    print(f"  CPU {cpu / elapsed:.2f} cores, {1e3 * cpu / max(made, 1):.0f} ms per picture; longest tick "
          f"{1e3 * max(ticks):.0f} ms, 95% below {1e3 * np.percentile(ticks, 95):.0f} ms")  # fmt: skip
    window.close()
    while application.run_one_tick():
        pass
    window.closed()


def main() -> int:
    """Command line; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("path", type=Path, metavar="TAKE|STREAM")
    parser.add_argument("--splats", type=int, default=60_000, help="splats per frame of a take (default %(default)s)")
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--size", default="1280x800", metavar="WxH")
    options = parser.parse_args()
    width, _, height = options.size.partition("x")
    try:
        device = check_display()
        with tempfile.TemporaryDirectory() as folder:
            place = options.path
            if (place / "take.json").is_file():
                place = Path(folder) / "stream"
                bake(options.path, options.splats, place)
            play(place, options.seconds, (int(width), int(height)), device)
    except StudioError as error:
        print(f"playback_window: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
