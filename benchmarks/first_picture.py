"""Time from opening an address to the first picture, over networks of limited rate.

    python benchmarks/first_picture.py TAKE|STREAM [--megabits 20 5] [--round-trip 60] [--runs 5]
        [--against PORT]

Serves the stream as `v3studio serve` does, behind a proxy that limits the rate and adds a round-trip time
(tests/support/slow_network.py), and opens it

- in Chromium (playwright), with an empty cache: from the start of the navigation to the first picture on the canvas,
- in the Python player: from `Player(address)` to the first decoded frame; the modules are imported before.

With `--against`, Chromium also opens the same stream from another server, such as `v3studio serve` of an older
checkout, in turns with this one: the speed of a busy machine changes from minute to minute. A picture counts when its
drawing is finished. CPU: what all of Chromium's processes used until then.

Prints the table of docs/measurements/stream.md: the median of the runs and their range.
"""

from __future__ import annotations

import argparse
import contextlib
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
LISTEN = """document.addEventListener('v3-ready', async ({target}) => {
  target.pause();
  await target.engine.renderer?.finish();
  window.v3Ready = performance.now();
}, true)"""


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


def in_chromium(browser: Any, address: str, details: bool) -> tuple[float, float]:
    """Seconds to the first picture, and seconds of CPU time."""
    before = cpu_seconds()
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
    used = cpu_seconds() - before
    context.close()
    return seconds, used


def cpu_seconds() -> float:
    """CPU time of all running processes named chromium that this one has started."""
    parents, times = {}, {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):
            number, _, rest = stat.read_text().rpartition(")")
            fields = rest.split()
            parents[int(stat.parent.name)] = int(fields[1])
            if "chrom" in number:
                times[int(stat.parent.name)] = (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
    own = {os.getpid()}
    while more := {child for child, parent in parents.items() if parent in own} - own:
        own |= more
    return sum(seconds for process, seconds in times.items() if process in own)


def in_python(address: str) -> tuple[float, float]:
    """Seconds to the first frame, and seconds of CPU time, the server's included."""
    from studio.playback import Player

    began, used = time.perf_counter(), time.process_time()
    with Player(address) as player:
        while player.frame() is None:
            time.sleep(0.001)
        return time.perf_counter() - began, time.process_time() - used


def row(name: str, runs: list[tuple[float, float]], sent: list[int]) -> str:
    seconds, used = zip(*runs, strict=True)
    middle, cpu = statistics.median(seconds), statistics.median(used)
    received = statistics.median(sent) / 1000
    return f"| {name} | {middle:.2f} s | {min(seconds):.2f} to {max(seconds):.2f} s | {cpu:.2f} s | {received:.0f} KB |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("stream", help="folder of a take or a stream")
    parser.add_argument("--megabits", type=float, nargs="+", default=[20.0, 5.0], help="rates in Mbit/s")
    parser.add_argument("--round-trip", type=float, default=60.0, help="milliseconds")
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--against", type=int, help="port of another server of the same stream")
    parser.add_argument("--details", action="store_true", help="tell when the browser fetched what")
    options = parser.parse_args()
    from playwright.sync_api import sync_playwright

    networks = [("loopback", None, 0.0)]
    networks += [
        (f"{rate:g} Mbit/s, {options.round_trip:g} ms", rate, options.round_trip / 1000) for rate in options.megabits
    ]
    print("| network | player | first picture | range | CPU | received by then |\n|---|---|---|---|---|---|")
    with contextlib.ExitStack() as stack:
        ports = {"Chromium": stack.enter_context(serving(options.stream))}
        if options.against is not None:
            ports["Chromium, other server"] = options.against
        ports["Python"] = ports["Chromium"]
        playwright = stack.enter_context(sync_playwright())
        browser = stack.enter_context(
            contextlib.closing(playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS))
        )

        def once(player: str, port: int) -> tuple[float, float]:
            address = f"http://127.0.0.1:{port}/"
            return in_python(address) if player == "Python" else in_chromium(browser, address, options.details)

        for player, port in ports.items():
            once(player, port)  # the first start of anything is slower
        for name, rate, round_trip in networks:
            seconds: dict[str, list[tuple[float, float]]] = {player: [] for player in ports}
            sent: dict[str, list[int]] = {player: [] for player in ports}
            for _ in range(options.runs):
                for player, port in ports.items():
                    with SlowNetwork(port, rate, round_trip) as network:
                        seconds[player].append(once(player, network.port))
                        sent[player].append(network.sent)
            for player in ports:
                print(row(f"{name} | {player}", seconds[player], sent[player]), flush=True)
            if options.against is not None:
                pairs = zip(seconds["Chromium"], seconds["Chromium, other server"], strict=True)
                print(f"  this one / other server: {statistics.median(a[0] / b[0] for a, b in pairs):.2f}", flush=True)
    print(f"\n{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f} at the end.")


if __name__ == "__main__":
    main()
