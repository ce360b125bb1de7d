"""Plays 300 frames while the rendition changes, and looks for frames that are repeated, skipped or late.

    python benchmarks/switching.py [--rates 1.5 0.3 0.8 0.2 2] [--seconds 6] [--frames 300] [--fps 10]

Bakes a small moving figure in three renditions, in groups of ten frames, and serves it behind a proxy
(tests/support/slow_network.py) with 60 ms round trip. The Python player and Chromium play it once, from the first
frame to the last, in three ways:

- network: every `--seconds`, the proxy changes to the next of `--rates`, which are relative to the best rendition's
  bandwidth, and the player chooses;
- every group: the network is fast, and the player's rule is replaced by one that changes at every group;
- never: the same with a rule that stays with the best rendition, to compare.

The figures: frames shown out of order, more than once or not at all; changes of rendition; the longest time that a
frame stayed on the screen where the rendition changed, and anywhere. For each frame that stayed half a frame too long,
stderr tells why, in milliseconds of its time:

- waiting: the next frame was due, and no picture was there;
- thread: the longest time in which the player's thread did nothing (no animation frame, no turn of the Python loop);
- task: the longest that a task of the page's own thread ran (Chromium). Where it is short and `thread` is long, the
  browser gave no animation frame, since its drawing, which is the CPU's, was behind;
- process: the longest delay of a thread of the same process that only counts time (Chromium: a worker);
- machine: the same of another process. What delays it is not ours.
"""

from __future__ import annotations

import argparse
import itertools
import os
import re
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

sys.path[:0] = [str(Path(__file__).parents[1]), str(Path(__file__).parents[1] / "tests" / "web")]

from first_picture import CHROMIUM, FLAGS, serving  # noqa: E402

from tests.support.slow_network import SlowNetwork  # noqa: E402

GROUP = 10
WAYS = ("network", "every group", "never")
LATE = 0.03  # seconds between two turns of a clock that turns every 5 ms
CLOCK = f"""
import time
last = time.time()
while True:
    time.sleep(0.005)
    now = time.time()
    if now - last > {LATE}:
        print(last, now, flush=True)
    last = now
"""
WATCH = f"""
const now = () => (performance.timeOrigin + performance.now()) / 1000;
window.shown = []; window.waiting = []; window.thread = []; window.task = []; window.process = [];
new PerformanceObserver((list) => {{
  for (const {{startTime, duration}} of list.getEntries()) {{
    const start = (performance.timeOrigin + startTime) / 1000;
    window.task.push([start, start + duration / 1000]);
  }}
}}).observe({{type: 'longtask'}});
const clock = `let last = 0; setInterval(() => {{
  const now = (performance.timeOrigin + performance.now()) / 1000;
  if (last > 0 && now - last > {LATE}) postMessage([last, now]);
  last = now;
}}, 5)`;
new Worker(URL.createObjectURL(new Blob([clock]))).onmessage = ({{data}}) => window.process.push(data);
let last = now();
const turn = () => {{
  requestAnimationFrame(turn);
  const at = now();
  if (at - last > {LATE}) window.thread.push([last, at]);
  const engine = document.querySelector('v3-player')?.engine;
  const due = engine?.requested?.frame <= engine?.position;
  if (due && engine.ready === null) window.waiting.push([last, at]);
  last = at;
}};
requestAnimationFrame(turn);
document.addEventListener('v3-time', ({{detail}}) => {{
  const {{engine}} = document.querySelector('v3-player');
  window.shown.push([detail.frame, now(), engine.group?.rendition ?? '']);
}}, true);
document.addEventListener('v3-ended', () => {{ window.over = true; }}, true);
document.addEventListener('v3-ready', () => document.querySelector('v3-player').removeAttribute('loop'), true);
"""
# what replaces the beginning of RateRule.choose in the built player
RULES = {
    "every group": "this.turn=(this.turn??-1)+1;return this.order[this.turn%this.order.length];",
    "never": "return this.order[this.order.length-1];",
}
Spans = list[tuple[float, float]]


class Shown(NamedTuple):
    """A frame on the screen: its number, when it appeared in seconds, and its rendition."""

    frame: int
    at: float
    rendition: str


class Played(NamedTuple):
    """What was shown, and spans of time in which something was late, by name."""

    shown: list[Shown]
    late: dict[str, Spans]


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


@contextmanager
def counting_time() -> Iterator[Spans]:
    """Runs a process that only counts time; afterwards, the list has the spans in which it did not run."""
    spans: Spans = []
    with subprocess.Popen([sys.executable, "-c", CLOCK], stdout=subprocess.PIPE, text=True) as clock:
        try:
            yield spans
        finally:
            clock.terminate()
        assert clock.stdout is not None
        for line in clock.stdout:
            start, end = map(float, line.split())
            spans.append((start, end))


def in_python(address: str, way: str) -> Played:
    """Play once with the Python player."""
    from studio.playback import Player, RateRule

    shown: list[Shown] = []
    late: dict[str, Spans] = {"waiting": [], "thread": [], "process": []}
    turns = itertools.count()
    chosen = RateRule.choose
    if way != "network":

        def choose(rule: Any, _buffered: float) -> int:
            order: list[int] = rule._order
            return order[next(turns) % len(order)] if way == "every group" else order[-1]

        RateRule.choose = choose  # type: ignore[method-assign]
    over = threading.Event()

    def count() -> None:
        last = time.time()
        while not over.wait(0.005):
            now = time.time()
            if now - last > LATE:
                late["process"].append((last, now))
            last = now

    threading.Thread(target=count, daemon=True).start()
    try:
        with Player(address) as player:
            sizes = {
                (number, one.bytes / one.frame_count): one.id
                for number in range(len(player.reader.group_starts))
                for one in (player.reader.group(number, rendition.id) for rendition in player.reader.renditions)
            }
            player.play()
            last = time.time()
            while not player.finished:
                item = player.frame()
                now = time.time()
                if now - last > LATE:
                    late["thread"].append((last, now))
                if player.buffering:
                    late["waiting"].append((last, now))
                last = now
                if item is not None and (not shown or item.frame != shown[-1].frame):
                    shown.append(Shown(item.frame, now, sizes[item.stats.group, item.stats.bytes]))
                time.sleep(0.002)
    finally:
        over.set()
        RateRule.choose = chosen  # type: ignore[method-assign]
    return Played(shown, late)


def in_chromium(playwright: Any, address: str, way: str) -> Played:
    """Play once in Chromium."""
    browser = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
    page = browser.new_page(viewport={"width": 400, "height": 500})
    page.add_init_script(WATCH)
    if way != "network":

        def change_rule(route: Any) -> None:
            body, changes = re.subn(r"choose\(\w\)\{", lambda found: found[0] + RULES[way], route.fetch().text())
            # Nor are groups fetched again in a better rendition.
            body, stops = re.subn(r"nextToImprove\(\)\{", lambda found: f"{found[0]}return null;", body)
            assert changes == stops == 1, "the built player has no RateRule.choose or GroupStore.nextToImprove"
            route.fulfill(body=body, content_type="text/javascript")

        page.route("**/v3-player*.js", change_rule)
    page.goto(address)
    page.wait_for_function("() => window.over", timeout=600_000)
    found = page.evaluate("() => ({shown, waiting, thread, task, process: window.process})")
    browser.close()
    return Played([Shown(*one) for one in found.pop("shown")], found)


def explain(played: Played, machine: Spans, fps: float) -> None:
    """Tell why frames stayed too long."""
    causes = {**played.late, "machine": machine}
    for before, after in itertools.pairwise(played.shown):
        if after.at - before.at > 1.5 / fps:
            within = {
                name: [min(end, after.at) - max(start, before.at) for start, end in spans]
                for name, spans in causes.items()
            }
            # All of the waiting; of the others the longest.
            waited = sum(max(0, one) for one in within.pop("waiting"))
            longest = {name: max([0, *spans]) for name, spans in within.items()}
            times = {name: round(1000 * one) for name, one in {"waiting": waited, **longest}.items()}
            told = ", ".join(f"{name} {time}" for name, time in times.items())
            changed = f", {before.rendition} to {after.rendition}" * (before.rendition != after.rendition)
            print(f"  frame {before.frame}: {1000 * (after.at - before.at):.0f} ms ({told}{changed})", file=sys.stderr)


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
    parser.add_argument("--ways", nargs="+", choices=WAYS, default=list(WAYS))
    parser.add_argument("--players", nargs="+", choices=("Python", "Chromium"), default=["Python", "Chromium"])
    options = parser.parse_args()
    from playwright.sync_api import sync_playwright

    with tempfile.TemporaryDirectory() as folder:
        best = bake(Path(folder), options.frames, options.fps)
        rates = [rate * best / 1e6 for rate in options.rates]
        print(
            "| player | rendition changes | frames shown | missing | repeated or out of order | changes of rendition | "
            "longest frame at a change | longest frame | a frame's duration | load |\n" + "|---" * 10 + "|"
        )
        with serving(folder) as port, sync_playwright() as playwright:
            for name, way in itertools.product(options.players, options.ways):
                print(f"{name}, {way}:", file=sys.stderr)
                with (
                    SlowNetwork(port, rates[0] if way == "network" else None, 0.06) as network,
                    counting_time() as late,
                ):
                    over = threading.Event()
                    if way == "network":
                        changing = (network, rates, options.seconds, over)
                        threading.Thread(target=change, args=changing, daemon=True).start()
                    address = f"http://127.0.0.1:{network.port}/"
                    played = in_python(address, way) if name == "Python" else in_chromium(playwright, address, way)
                    over.set()
                explain(played, late, options.fps)
                print(
                    report(f"{name} | {way}", played.shown, options.frames, options.fps, os.getloadavg()[0]), flush=True
                )


if __name__ == "__main__":
    main()
