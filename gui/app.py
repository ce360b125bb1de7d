"""`v3studio-gui [TAKE|STREAM]`: opens the window on a take or a stream."""

import argparse
import contextlib
import os
import signal
import sys
import traceback
from collections.abc import Callable, Sequence
from pathlib import Path
from types import FrameType

from v3studio.studio.errors import StudioError
from v3studio.studio.process import forget_working_folder, passive_openmp

MOST_FAILURES = 5  # exceptions without a completed tick between them after which the window is closed


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point. Returns the exit status: 0, 1 if the window failed, or 2 if it cannot be opened."""
    forget_working_folder()
    passive_openmp()
    parser = argparse.ArgumentParser(
        prog="v3studio-gui",
        description="From footage to a reviewed Gaussian video: run the stages of a take, play and compare.",
    )
    parser.add_argument(
        "path",
        nargs="?",
        metavar="TAKE|STREAM|CAST",
        help="folder of a take or of a stream, URL of a stream, or the .json document of a cast",
    )
    parser.add_argument(
        "--size", default="1280x800", metavar="WxH", help="window size at 96 dpi (default: %(default)s)"
    )
    parser.add_argument(
        "--log-state", type=Path, metavar="FILE", help="append the window's state to FILE as JSON lines"
    )
    options = parser.parse_args(arguments)
    width, _, height = options.size.partition("x")
    if not (width.isdecimal() and height.isdecimal() and int(width) >= 480 and int(height) >= 320):
        parser.error(f"--size: '{options.size}' is not WIDTHxHEIGHT of at least 480x320; example: 1280x800")
    try:
        device = check_display()
    except StudioError as error:
        print(f"v3studio-gui: {error}", file=sys.stderr)
        return 2
    return _run(options.path, (int(width), int(height)), options.log_state, device)


def check_display() -> str:
    """Name and kind of the Vulkan device. Raises StudioError: without it or a display, Open3D aborts."""
    from v3studio.gui.platform.vulkan import vulkan_device

    if sys.platform.startswith("linux"):
        if not os.environ.get("DISPLAY") and not os.environ.get("WAYLAND_DISPLAY"):
            fix = "Start it from a desktop session."
            raise StudioError("gui.no_display", "the window needs a display and DISPLAY is not set", fix=fix)
        if os.environ.get("DISPLAY"):
            # GLFW would choose Wayland if both are available, but Filament draws through X11.
            os.environ["XDG_SESSION_TYPE"] = "x11"
    return vulkan_device()


def _run(path: str | None, size: tuple[int, int], log: Path | None, device: str) -> int:
    """Open the window and run it until it is closed, Ctrl-C or SIGTERM."""
    from open3d.visualization import gui

    from v3studio.gui.platform.screen import fitting_size
    from v3studio.gui.window import MainWindow

    application = gui.Application.instance
    application.initialize()
    window = MainWindow(fitting_size(size), log, device, device.endswith("(software)"))
    stopped = False

    def stop(_number: int, _frame: FrameType | None) -> None:
        nonlocal stopped
        stopped = True

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, stop)

    def tick() -> bool:
        nonlocal stopped
        # Ticking until False lets the window close in order; leaving earlier made Python hang or crash at exit.
        if not application.run_one_tick():
            return False
        if stopped or window.close_requests.wanted:
            stopped = window.close_requests.wanted = False
            window.close()
        return True

    try:
        if path is not None:
            window.open(path)
        if run_ticks(tick, lambda: window.ticks, window.reports.failed):
            return 0
        print("v3studio-gui: the window keeps failing and is closed; jobs keep running", file=sys.stderr)
        window.close()
        run_ticks(application.run_one_tick, lambda: None, lambda error: None)
        return 1
    finally:
        window.closed()


def run_ticks(tick: Callable[[], bool], progress: Callable[[], object], report: Callable[[Exception], None]) -> bool:
    """Tick until there is no window; `tick` returns False then. False if it was given up after `MOST_FAILURES`
    exceptions without progress. What a callback of the toolkit raises comes out of a tick. It is reported, and the
    window keeps running: one failure must not freeze it."""
    failures, before = 0, progress()
    while True:
        try:
            if not tick():
                return True
        except Exception as error:
            traceback.print_exception(error)
            failures += 1
            if failures >= MOST_FAILURES:
                return False
            with contextlib.suppress(Exception):  # it may be the display of messages that fails
                report(error)
        if progress() != before:
            failures, before = 0, progress()


if __name__ == "__main__":
    sys.exit(main())
