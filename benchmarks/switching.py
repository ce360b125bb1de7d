"""Plays 300 frames over a network whose rate changes, and looks for frames that are repeated, skipped or late.

    python benchmarks/switching.py [--rates 1.5 0.3 0.8 0.2 2] [--seconds 6] [--frames 300] [--fps 10]

Bakes a small moving figure in three renditions, in groups of ten frames, and serves it behind a proxy
(tests/support/slow_network.py) with 60 ms round trip. Every `--seconds`, the proxy changes to the next of `--rates`,
which are relative to the best rendition's bandwidth. The Python player and Chromium play it once, from the first frame
to the last. The figures: frames shown out of order, more than once or not at all; changes of rendition; the longest
time that a frame stayed on the screen anywhere, and where the rendition changed.
"""

from __future__ import annotations

import argparse
import itertools
import os
import sys
import tempfile
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

sys.path[:0] = [str(Path(__file__).parents[1]), str(Path(__file__).parents[1] / "tests" / "web")]

from first_picture import CHROMIUM, FLAGS, serving  # noqa: E402

from tests.support.slow_network import SlowNetwork  # noqa: E402

GROUP = 10
WATCH = """
document.addEventListener('v3-time', ({detail}) => {
  const {engine} = document.querySelector('v3-player');
  (window.shown ??= []).push([detail.frame, performance.now() / 1000, engine.group?.rendition ?? '']);
}, true);
document.addEventListener('v3-ended', () => { window.over = true; }, true);
document.addEventListener('v3-ready', () => document.querySelector('v3-player').removeAttribute('loop'), true);
"""


class Shown(NamedTuple):
    """A frame on the screen: its number, when it appeared in seconds, and its rendition."""

    frame: int
    at: float
    rendition: str


def bake(folder: Path, frames: int, fps: float) -> int:
    """The stream; returns the best rendition's bandwidth."""
    import support

    from studio.stream import BakeSettings, Rung, StreamReader, bake_group, write_manifest

    ladder = (Rung(qp=12), Rung(qp=24), Rung(qp=34))
    settings = BakeSettings(stream_version=3, ladder=ladder, preset="ultrafast")
    figure = support.body(frames, 1500, 0)
    entries = [
        bake_group(figure[first : first + GROUP], folder, number, first, settings, fps=fps)
        for number, first in enumerate(range(0, frames, GROUP))
    ]
    write_manifest(folder, entries, fps, settings)
    with StreamReader.open(folder) as reader:
        for one in reader.renditions:
            print(f"{one.id}: {one.bandwidth / 1e6:.2f} Mbit/s", file=sys.stderr)
        return reader.renditions[0].bandwidth


def change(network: SlowNetwork, rates: Sequence[float], seconds: float, over: threading.Event) -> None:
    """Set the network's rate to the next one every few seconds."""
    for rate in itertools.cycle(rates):
        network.megabits = rate
        if over.wait(seconds):
            return


def in_python(address: str) -> list[Shown]:
    """Play once with the Python player."""
    from studio.playback import Player

    shown: list[Shown] = []
    with Player(address) as player:
        sizes = {
            (number, one.bytes / one.frame_count): one.id
            for number in range(len(player.reader.group_starts))
            for one in (player.reader.group(number, rendition.id) for rendition in player.reader.renditions)
        }
        player.play()
        while not player.finished:
            item = player.frame()
            if item is not None and (not shown or item.frame != shown[-1].frame):
                shown.append(Shown(item.frame, time.perf_counter(), sizes[item.stats.group, item.stats.bytes]))
            time.sleep(0.002)
    return shown


def in_chromium(playwright: Any, address: str) -> list[Shown]:
    """Play once in Chromium."""
    browser = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
    page = browser.new_page(viewport={"width": 400, "height": 500})
    page.add_init_script(WATCH)
    page.goto(address)
    page.wait_for_function("() => window.over", timeout=600_000)
    shown = [Shown(*one) for one in page.evaluate("() => window.shown")]
    browser.close()
    return shown


def report(name: str, shown: list[Shown], frames: int, fps: float, load: float) -> str:
    """A row of the table."""
    numbers = [one.frame for one in shown]
    missing = len(set(range(frames)) - set(numbers))
    wrong = sum(after <= before for before, after in itertools.pairwise(numbers))
    gaps = [(after.at - before.at, after.rendition != before.rendition) for before, after in itertools.pairwise(shown)]
    switches = [gap for gap, changed in gaps if changed]
    at_switch = max(switches, default=0)
    return (
        f"| {name} | {len(numbers)} | {missing} | {wrong} | {len(switches)} | {1000 * at_switch:.0f} ms | "
        f"{1000 * max(gap for gap, _ in gaps):.0f} ms | {1000 / fps:.0f} ms | {load:.1f} |"
    )


def main() -> None:
    """Bake, serve, play, report."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rates", type=float, nargs="+", default=[1.5, 0.3, 0.8, 0.2, 2.0])
    parser.add_argument("--seconds", type=float, default=6.0)
    parser.add_argument("--frames", type=int, default=300)
    parser.add_argument("--fps", type=float, default=10.0)
    options = parser.parse_args()
    from playwright.sync_api import sync_playwright

    with tempfile.TemporaryDirectory() as folder:
        best = bake(Path(folder), options.frames, options.fps)
        rates = [rate * best / 1e6 for rate in options.rates]
        print(
            "| player | frames shown | missing | repeated or out of order | changes of rendition | longest frame at a "
            "change | longest frame | a frame's duration | load |\n|---|---|---|---|---|---|---|---|---|"
        )
        with serving(folder) as port, sync_playwright() as playwright:
            for name in ("Python", "Chromium"):
                with SlowNetwork(port, rates[0], 0.06) as network:
                    over = threading.Event()
                    threading.Thread(target=change, args=(network, rates, options.seconds, over), daemon=True).start()
                    address = f"http://127.0.0.1:{network.port}/"
                    shown = in_python(address) if name == "Python" else in_chromium(playwright, address)
                    over.set()
                print(report(name, shown, options.frames, options.fps, os.getloadavg()[0]), flush=True)


if __name__ == "__main__":
    main()
