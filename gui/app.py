"""`v3studio-gui [TAKE|STREAM]`: opens the window on a take or a stream."""

from __future__ import annotations

import argparse
import os
import signal
import sys
from collections.abc import Sequence
from pathlib import Path
from types import FrameType

from studio.environment import passive_openmp
from studio.errors import StudioError


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point. Returns the exit status: 0, or 2 if the window cannot be opened."""
    passive_openmp()
    parser = argparse.ArgumentParser(
        prog="v3studio-gui",
        description="From footage to a reviewed Gaussian video: run the stages of a take, play and compare.",
    )
    parser.add_argument(
        "path", nargs="?", metavar="TAKE|STREAM", help="folder of a take or of a stream, or URL of a stream"
    )
    parser.add_argument(
        "--size",
        default="1280x800",
        metavar="WxH",
        help="window size at 96 dpi (default: %(default)s)",
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
    """Check that a window can be opened: without a display or a Vulkan device, Open3D aborts without a message.

    Returns:
        name and kind of the Vulkan device, for example "llvmpipe (software)".

    Raises:
        StudioError: no display, or no Vulkan device.
    """
    from gui.platform.vulkan import vulkan_devices

    if sys.platform.startswith("linux"):
        if not os.environ.get("DISPLAY") and not os.environ.get("WAYLAND_DISPLAY"):
            raise StudioError(
                "gui.no_display",
                "the window needs a display and DISPLAY is not set",
                fix="Start it from a desktop session.",
            )
        if os.environ.get("DISPLAY"):
            # GLFW would choose Wayland if both are available, but Filament draws through X11.
            os.environ["XDG_SESSION_TYPE"] = "x11"
    device = vulkan_devices()[0]
    return f"{device.name} ({device.kind})"


def _run(path: str | None, size: tuple[int, int], log: Path | None, device: str) -> int:
    """Open the window and run it until it is closed, Ctrl-C or SIGTERM."""
    from open3d.visualization import gui

    from gui.platform.screen import fitting_size
    from gui.window import MainWindow

    application = gui.Application.instance
    application.initialize()
    window = MainWindow(fitting_size(size), log, device, device.endswith("(software)"))
    stopped = False

    def stop(_number: int, _frame: FrameType | None) -> None:
        nonlocal stopped
        stopped = True

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, stop)
    if path is not None:
        window.open(path)
    # Ticking until False lets the window close in order; leaving earlier made Python hang or crash at exit.
    while application.run_one_tick():
        if stopped or window.wants_close:
            stopped = window.wants_close = False
            window.close()
    window.closed()
    return 0


if __name__ == "__main__":
    sys.exit(main())
