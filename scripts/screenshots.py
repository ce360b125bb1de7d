"""Photographs every screen of the window, for people who changed something, or those of the documentation.

    python scripts/screenshots.py TAKE OUT [--size 1280x800] [--only NAME ...]
    python scripts/screenshots.py TAKE docs/images --only capture train review difference
    python scripts/screenshots.py MARKED docs/images --only points

TAKE is a finished take of the sample capture (`make demo`), MARKED one whose cameras were calibrated from
docs/tie_points.yaml, which names the footage and the command. Takes are copied, since some screens change them. Writes
OUT/gui_NAME.png. Needs what the window's tests need (`make setup-tests`): Xvfb and xdotool.
"""

import argparse
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
from PIL import Image

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from gui.actions.commands import ITEMS
from tests.gui.conftest import RunningWindow
from tests.support.x_server import x_server

CAMERA, FRAME = "cam12", 14  # held out; the axe points at this camera
SECONDS = 600.0  # longest wait for a state; generous, because another program may be using the CPU

MOST_PICTURES, CHANGING = 20, 0.0005
"""Pictures until the screen must have come to rest, and the share of its pixels that may change then."""

Screen = Callable[[RunningWindow], None]
SCREENS: dict[str, Screen] = {}


def keys(*names: str) -> Screen:
    def go(window: RunningWindow) -> None:
        for name in names:
            window.key(name)

    return go


def press_until(window: RunningWindow, key: str, **wanted: Any) -> None:
    """Press a key until the state has these values."""
    for _ in range(100):
        state = window.wait_for("a picture", lambda s: s["settled"], SECONDS)
        if all(state[name] == value for name, value in wanted.items()):
            return
        window.key(key)
    raise SystemExit(f"The key {key} never led to {wanted}.")


def compared(*names: str) -> Screen:
    """The decoded stream in a held-out camera; the keys compare it with the footage."""

    def go(window: RunningWindow) -> None:
        window.key("3")
        press_until(window, "c", camera=CAMERA)
        keys("z", *names)(window)

    return go


def stage(name: str, mode: str = "", *names: str) -> Screen:
    """Select a stage and one of its images, and press keys."""

    def go(window: RunningWindow) -> None:
        window.stage(name)
        if mode:
            window.click(mode)
        window.wait_for(mode or name, lambda state: state["settled"], SECONDS)
        keys(*names)(window)

    return go


def menu(name: str) -> Screen:
    """Run an item of a menu, by the name of its action: in the list of commands, as the toolkit does not report where
    the menus' items are, and a click beside them would press what is below."""
    words = ITEMS[name].words

    def go(window: RunningWindow) -> None:
        commands(words)(window)
        window.wait_for(words, lambda state: bool(state["lines"]) and state["lines"][0] == words, SECONDS)
        window.key("Return")
        window.wait_for(f"the dialog of {words}", lambda state: state["dialog"] not in ("", "commands"), SECONDS)

    return go


def edit_tool(*names: str) -> Screen:
    """Open the edits and press some of their buttons."""

    def go(window: RunningWindow) -> None:
        window.key("x")
        window.wait_for("the edits", lambda state: "look" in state["mode"] and state["settled"], SECONDS)
        for name in names:
            window.click(name)
            window.wait_for(name, lambda state: state["settled"], SECONDS)

    return go


def commands(typed: str) -> Screen:
    """Search the commands."""

    def go(window: RunningWindow) -> None:
        window.chord("k")
        window.wait_for("the list of commands", lambda state: state["typing"], SECONDS)
        window.enter_text("dialog line", typed)

    return go


SCREENS |= {
    "scene": keys(),
    "commands": commands("mark"),
    "log": keys("j"),
    "camera": compared(),
    "review": compared("w"),
    "difference": compared("d"),
    "side_by_side": compared("s"),
    "edit": keys("x"),
    "edit_crop": edit_tool("crop"),
    "edit_floaters": edit_tool("floaters"),
    "edit_numbers": edit_tool("crop", "numbers"),
    "edit_detail": edit_tool("detail"),
    "path": keys("k"),
    "fullscreen": keys("f"),
    "all_cameras": keys("o"),
    "queue": keys("q"),
    "mark": keys("m"),
    "shortcuts": keys("question"),
    "capture": stage("capture"),
    "capture_images": stage("capture", "masks"),
    "calibrate": stage("calibrate"),
    "calibrate_report": stage("calibrate", "report"),
    "points": stage("calibrate", "points by hand", "Down", "c", "Down", "c", "r"),
    "initialize": stage("initialize"),
    "train": stage("train"),
    "train_colors": stage("train", "camera colors"),
    "bake": stage("bake"),
}
SCREENS |= {f"help_{name}": stage(name, "", "F1") for name in ("capture", "initialize", "train", "review")}
SCREENS |= {
    "new_take": menu("new"),
    "open": menu("open"),
    "preferences": menu("preferences"),
    "cameras": stage("capture", "cameras"),
    "bakes": stage("bake", "bakes"),
    "worst": menu("worst"),
    "export": menu("export"),
    "share": menu("share folder"),
    "serve": menu("serve"),
    "about": menu("about"),
    "span": keys("Home", "t", "Right", "Right", "Right", "t"),
}


def take_picture(window: RunningWindow, path: Path) -> None:
    """Write the screen once it stays the same.

    The pointer rests at the empty end of the status line, where no tooltip covers anything. Each move has the window
    drawn: Open3D drops a frame while the last one is still being drawn, which takes seconds at 3840x2160 without a GPU.
    """
    width, height = (int(part) for part in window.xdotool("getdisplaygeometry").split())
    before, same = np.zeros(0, np.uint8), 0
    for step in range(MOST_PICTURES):
        window.send("mousemove", round(0.7 * width) + step % 2, round(0.967 * height))
        window.ticks(30)  # the panels follow later than the viewport
        time.sleep(width * height / 1e6)
        window.screenshot().save(path)
        now = np.asarray(Image.open(path).convert("RGB"))
        # figures of the speed change with each draw
        same = same + 1 if before.shape == now.shape and (before != now).any(axis=2).mean() < CHANGING else 0
        if same == 2:
            print(path, flush=True)
            return
        before = now
    print(f"{path}: it kept changing", file=sys.stderr, flush=True)


def photograph(window: RunningWindow, name: str, go: Screen, out: Path) -> None:
    """Go to a screen from Review, write its image, and go back."""
    go(window)
    window.wait_for(name, lambda state: state["settled"], SECONDS)
    take_picture(window, out / f"gui_{name}.png")
    for _ in range(5):
        state = window.states()[-1]
        edits = name.startswith("edit") and not {"footage", "trained", "decoded"} & set(state["mode"])
        if not (state["dialog"] or state["fullscreen"] or state["span"] or edits):
            break
        window.key("Escape")
        window.ticks(30)  # the next state
    if name in ("path", "all_cameras", "log"):
        window.key({"path": "p", "all_cameras": "o", "log": "j"}[name])
    if window.states()[-1]["stage"] != "review":
        window.stage("review")
    if window.states()[-1]["compare"] != "single":
        window.key({"wipe": "w", "difference": "d"}.get(window.states()[-1]["compare"], "s"))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("take", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--size", default="1280x800", help="of the screen and the window, pixels")
    parser.add_argument("--only", nargs="+", metavar="NAME", help="these screens only")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))  # ends the window and its X server
    with tempfile.TemporaryDirectory() as folder, x_server(options.size) as display:
        take = Path(shutil.copytree(options.take, Path(folder) / "take"))
        with closing(RunningWindow(display, Path(folder) / "state.jsonl", "--size", options.size)) as window:
            window.wait_for("the start page", lambda state: state["start"] and state["start_places"], SECONDS)
            if not options.only or "empty" in options.only:
                take_picture(window, options.out / "gui_empty.png")
        with closing(RunningWindow(display, Path(folder) / "taken.jsonl", str(take), "--size", options.size)) as window:
            window.wait_for("a take", lambda state: state["frames"] > 1 and not state["opening"], SECONDS)
            if window.states()[-1]["playing"]:
                window.key("space")
            window.key("Home")
            press_until(window, "Right", frame=min(FRAME, window.states()[-1]["frames"] - 1))
            for name, go in SCREENS.items():
                if not options.only or name in options.only:
                    photograph(window, name, go, options.out)


if __name__ == "__main__":
    main()
