"""Takes the screenshots of the window in docs/images, so that they can be retaken after a change.

    python scripts/screenshots.py TAKE [--points TAKE] [--out docs/images]

TAKE is a finished take of the sample capture (`make demo`). The take of `--points` is one whose cameras were calibrated
from docs/tie_points.yaml, which names the footage and the command; without it, gui_points.png is left as it is. Needs
what the window's tests need (`make setup-tests`): Xvfb and xdotool.
"""

import argparse
import sys
import tempfile
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from tests.gui.conftest import RunningWindow  # noqa: E402
from tests.support.x_server import x_server  # noqa: E402

SIZE = "1280x800"
CAMERA, FRAME = "cam12", 14  # held out; the axe points at this camera
SECONDS = 600.0  # longest wait for a state; generous, because another program may be using the CPU


@contextmanager
def opened(display: str, take: Path) -> Iterator[RunningWindow]:
    """The window on a take, once it has read it."""
    with tempfile.TemporaryDirectory() as folder:
        state = Path(folder) / "state.jsonl"
        with closing(RunningWindow(display, state, str(take), "--size", SIZE)) as window:
            window.wait_for("a take", lambda s: s["frames"] > 1 and not s["opening"], SECONDS)
            yield window


def save(window: RunningWindow, path: Path, **wanted: Any) -> None:
    """Wait for a state with these values and its image, then write the screen."""
    window.wait_for(
        str(wanted), lambda s: s["settled"] and all(s[name] == value for name, value in wanted.items()), SECONDS
    )
    window.ticks(100)  # the panels follow later than the viewport
    window.screenshot().save(path)
    print(path)


def press_until(window: RunningWindow, key: str, **wanted: Any) -> None:
    """Press a key until the state has these values."""
    for _ in range(100):
        state = window.wait_for("a picture", lambda s: s["settled"], SECONDS)
        if all(state[name] == value for name, value in wanted.items()):
            return
        window.key(key)
    raise SystemExit(f"The key {key} never led to {wanted}.")


def stages(display: str, take: Path, out: Path) -> None:
    """Capture, training and review of a finished take."""
    with opened(display, take) as window:
        if window.states()[-1]["playing"]:
            window.key("space")
        window.key("Home")
        press_until(window, "Right", frame=FRAME)
        window.stage("capture")
        save(window, out / "gui_capture.png", stage="capture")
        window.stage("train")
        save(window, out / "gui_train.png", stage="train")
        window.stage("review")
        window.key("3")
        press_until(window, "c", camera=CAMERA)
        window.key("z")
        window.key("w")
        save(window, out / "gui_review.png", compare="wipe", what="decoded", frame=FRAME)
        window.key("d")
        save(window, out / "gui_difference.png", compare="difference", what="decoded", frame=FRAME)


def points(display: str, take: Path, out: Path) -> None:
    """Points marked by hand."""
    with opened(display, take) as window:
        window.stage("calibrate")
        window.click("points by hand")
        window.wait_for("the view", lambda s: s["mode"] == ["points by hand"] and s["settled"], SECONDS)
        for _ in range(2):
            window.key("Down")
            window.key("c")
        window.key("r")
        save(window, out / "gui_points.png", mode=["points by hand"])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("take", type=Path)
    parser.add_argument("--points", type=Path, metavar="TAKE")
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "images")
    options = parser.parse_args()
    with x_server(SIZE) as display:
        stages(display, options.take, options.out)
        if options.points:
            points(display, options.points, options.out)


if __name__ == "__main__":
    main()
