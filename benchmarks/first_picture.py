"""Time from opening an address to the first picture, over networks of limited rate.

    python benchmarks/first_picture.py TAKE|STREAM [--megabits 5 20] [--round-trip 60] [--runs 5]

Serves the stream as `v3studio serve` does, behind a proxy that limits the rate and adds a round-trip time
(tests/support/slow_network.py), and opens it

- in Chromium (playwright), with an empty cache: from the start of the navigation to the first picture on the canvas,
- in the Python player: from `Player(address)` to the first decoded frame; the modules are imported before.

Prints the table of docs/measurements/stream.md: the median of the runs and their range.
"""

from __future__ import annotations

import argparse
import os
import statistics
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))

from tests.support.slow_network import SlowNetwork

CHROMIUM = "/usr/bin/chromium"
FLAGS = ["--no-sandbox", "--disable-background-networking", "--disable-component-update", "--disable-sync"]
LISTEN = """document.addEventListener('v3-ready', () => { window.v3Ready = performance.now(); }, true)"""


@contextmanager
def serving(folder: str) -> Iterator[int]:
    """Serve a take or a stream with the player; gives the port."""
    import uvicorn

    from pipelines.share.listening import listen
    from pipelines.share.player_files import read_player
    from pipelines.share.served_streams import find_streams
    from pipelines.share.web_app import build_app

    with listen("127.0.0.1", 0) as sock:
        config = uvicorn.Config(build_app(find_streams(folder), read_player()), log_level="warning", lifespan="off")
        server = uvicorn.Server(config)
        thread = threading.Thread(target=server.run, kwargs={"sockets": [sock]}, daemon=True)
        thread.start()
        yield sock.getsockname()[1]
        server.should_exit = True
        thread.join(5)


def in_chromium(browser: Any, address: str, details: bool) -> float:
    """Seconds to the first picture."""
    context = browser.new_context(viewport={"width": 800, "height": 600})
    page = context.new_page()
    page.add_init_script(LISTEN)
    page.goto(address, wait_until="commit")
    page.wait_for_function("() => window.v3Ready !== undefined", timeout=120_000)
    if details:
        entries = page.evaluate(
            "() => performance.getEntriesByType('resource').map(e => [e.name, e.startTime, e.responseEnd])"
        )
        for name, start, end in entries:
            print(f"    {start:6.0f} to {end:6.0f} ms  {name.rsplit('/', 1)[-1][:40]}", file=sys.stderr)
    seconds: float = page.evaluate("() => window.v3Ready") / 1000
    context.close()
    return seconds


def in_python(address: str) -> float:
    """Seconds to the first frame."""
    from studio.playback import Player

    began = time.perf_counter()
    with Player(address) as player:
        while player.frame() is None:
            time.sleep(0.001)
        return time.perf_counter() - began


def row(name: str, seconds: list[float], sent: list[int]) -> str:
    middle, low, high = statistics.median(seconds), min(seconds), max(seconds)
    return f"| {name} | {middle:.2f} s | {low:.2f} to {high:.2f} s | {statistics.median(sent) / 1000:.0f} KB |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("stream", help="folder of a take or a stream")
    parser.add_argument("--megabits", type=float, nargs="+", default=[20.0, 5.0], help="rates in Mbit/s")
    parser.add_argument("--round-trip", type=float, default=60.0, help="milliseconds")
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--details", action="store_true", help="tell when the browser fetched what")
    options = parser.parse_args()
    from playwright.sync_api import sync_playwright

    networks = [("loopback", None, 0.0)]
    networks += [
        (f"{rate:g} Mbit/s, {options.round_trip:g} ms", rate, options.round_trip / 1000) for rate in options.megabits
    ]
    print("| network | player | first picture | range | received by then |\n|---|---|---|---|---|")
    with serving(options.stream) as port, sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        in_chromium(browser, f"http://127.0.0.1:{port}/", False)  # the first start of anything is slower
        in_python(f"http://127.0.0.1:{port}/")
        for name, rate, round_trip in networks:
            for player in ("Chromium", "Python"):
                seconds, sent = [], []
                for _ in range(options.runs):
                    with SlowNetwork(port, rate, round_trip) as network:
                        address = f"http://127.0.0.1:{network.port}/"
                        one = (
                            in_python(address) if player == "Python" else in_chromium(browser, address, options.details)
                        )
                        seconds.append(one)
                        sent.append(network.sent)
                print(row(f"{name} | {player}", seconds, sent), flush=True)
        browser.close()
    print(f"\n{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f} at the end.")


if __name__ == "__main__":
    main()
