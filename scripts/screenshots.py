"""Takes the screenshots of the documentation.

    python scripts/screenshots.py TAKE docs/images start capture train review difference
    python scripts/screenshots.py MARKED docs/images points

TAKE is a finished take of the sample capture (`make demo`), MARKED one whose cameras were calibrated from
docs/tie_points.yaml, which names the footage and the command. Takes are copied, since some screens change them. Writes
OUT/gui_NAME.png. Needs what the window's tests need (`make setup-tests`): Xvfb and xdotool.
"""

import argparse
import json
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from tests.gui.conftest import RunningWindow
from tests.support.x_server import x_server
from v3studio.pipelines.config import load_config
from v3studio.pipelines.takes.files.settings_file import save_config
from v3studio.pipelines.takes.take import Take

SETTINGS = Path(__file__).resolve().parents[1] / "sample_configs" / "quickstart.yaml"
SIZE = "1280x800"
CAMERA, FRAME = "cam05", 14  # held out
SECONDS = 600.0  # longest wait for a state; generous, because another program may be using the CPU

MOST_PICTURES, CHANGING = 20, 0.0005
"""Pictures until the screen must have come to rest, and the share of its pixels that may change then."""

Screen = Callable[[RunningWindow], None]


def press_until(window: RunningWindow, key: str, **wanted: Any) -> None:
    """Press a key until the state has these values."""
    for _ in range(100):
        state = window.wait_for("a picture", lambda s: s["settled"], SECONDS)
        if all(state[name] == value for name, value in wanted.items()):
            return
        window.key(key)
    raise SystemExit(f"The key {key} never led to {wanted}.")


def compared(key: str) -> Screen:
    """The performer of the decoded stream in a held-out camera; the key compares it with the footage."""

    def go(window: RunningWindow) -> None:
        window.key("3")
        press_until(window, "c", camera=CAMERA)
        window.key("z")
        window.key(key)

    return go


def stage(name: str, mode: str = "", *keys: str) -> Screen:
    """Select a stage and one of its images, and press keys."""

    def go(window: RunningWindow) -> None:
        window.stage(name)
        if mode:
            window.click(mode)
        window.wait_for(mode or name, lambda state: state["settled"], SECONDS)
        for key in keys:
            window.key(key)

    return go


def start_page(window: RunningWindow) -> None:
    """The page that the window begins with, with the takes that were open last."""


SCREENS: dict[str, Screen] = {
    "start": start_page,
    "capture": stage("capture"),
    "points": stage("calibrate", "points by hand", "Down", "c", "Down", "c", "r"),
    "train": stage("train"),
    "review": compared("w"),
    "difference": compared("d"),
}


def take_picture(window: RunningWindow, path: Path) -> None:
    """Write the screen once it stays the same.

    The pointer rests at the empty end of the status line, where no tooltip covers anything. Each move has the window
    drawn: Open3D drops a frame while the last one is still being drawn.
    """
    width, height = map(int, SIZE.split("x"))
    before, same = np.zeros((height, width, 3), np.uint8), 0
    for step in range(MOST_PICTURES):
        window.send("mousemove", round(0.7 * width) + step % 2, round(0.967 * height))
        window.ticks(30)  # the panels follow later than the viewport
        time.sleep(1)
        image = window.screenshot()
        now = np.asarray(image)
        # figures of the speed change with each draw
        same = same + 1 if (before != now).any(axis=2).mean() < CHANGING else 0
        if same == 2:
            image.save(path)
            print(path, flush=True)
            return
        before = now
    raise SystemExit(f"{path}: it kept changing")


def new_take(folder: Path) -> Path:
    """A take of the sample capture that was not run yet."""
    save_config(Take.create(folder).config, load_config(SETTINGS))
    return folder


def remember(*takes: Path, folder: Path) -> None:
    """Write the window's preferences with these takes as the last ones."""
    path = folder / "config" / "v3studio" / "window.json"
    path.parent.mkdir(parents=True)
    path.write_text(json.dumps({"recent": [str(take) for take in takes]}))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("take", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("names", nargs="+", choices=SCREENS)
    options = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))  # ends the window and its X server
    with tempfile.TemporaryDirectory() as folder, x_server(SIZE) as display:
        take = shutil.copytree(options.take, Path(folder) / "takes" / "dance")
        remember(take, new_take(take.parent / "jump"), take / "stream", folder=Path(folder))
        for name in options.names:
            log = Path(folder) / f"{name}.jsonl"
            opened = () if name == "start" else (str(take),)
            with closing(RunningWindow(display, log, *opened, "--size", SIZE)) as window:
                if opened:
                    window.wait_for("a take", lambda state: state["frames"] > 1 and not state["opening"], SECONDS)
                    window.key("Home")
                    press_until(window, "Right", frame=min(FRAME, window.states()[-1]["frames"] - 1))
                SCREENS[name](window)
                window.wait_for(name, lambda state: state["settled"], SECONDS)
                take_picture(window, options.out / f"gui_{name}.png")


if __name__ == "__main__":
    main()
