"""Measure when a shared page shows its poster and its first image over slow lines, in Chromium.

    python benchmarks/first_image.py STREAM

All connections share one line of the given rate, and each request waits for a round trip first. Prints the median of
three new pages for each rate, from a server that compresses text and from one that does not.
"""

import gzip
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from statistics import median
from typing import Any

from playwright.sync_api import sync_playwright

from v3studio.pipelines.share.page import PageText
from v3studio.pipelines.share.sharing import share

RATES = (0.4, 1.5, 4.0)  # Mbit/s
ROUND_TRIP = 0.05  # seconds
PIECE = 1400  # bytes
PAGES = 3
TEXT = ("html", "javascript", "json")
WATCH = """
addEventListener('v3-ready', () => { window.first ??= performance.now(); }, true);
new PerformanceObserver(list => {
  for (const {url, renderTime, loadTime} of list.getEntries())
    if (url.includes('poster')) window.poster ??= renderTime || loadTime;
}).observe({type: 'largest-contentful-paint', buffered: true});
"""


class Line:
    """A line with a rate, which all connections share."""

    def __init__(self, megabits: float) -> None:
        self._rate = megabits * 1e6 / 8
        self._free = 0.0
        self._lock = threading.Lock()

    def carry(self, count: int) -> None:
        """Wait until these bytes have come through."""
        with self._lock:
            self._free = max(self._free, time.monotonic()) + count / self._rate
            until = self._free
        time.sleep(max(0.0, until - time.monotonic()))


@contextmanager
def served(folder: Path, line: Line, compress: bool) -> Iterator[str]:
    """The address of a folder behind the line. `compress`: the folder's text is compressed."""

    class Handler(SimpleHTTPRequestHandler):
        protocol_version = "HTTP/1.1"

        def log_message(self, *_arguments: Any) -> None:
            pass

        def do_GET(self) -> None:
            time.sleep(ROUND_TRIP)
            super().do_GET()

        def send_header(self, keyword: str, value: str) -> None:
            super().send_header(keyword, value)
            if compress and keyword == "Content-type" and value.endswith(TEXT):
                super().send_header("Content-Encoding", "gzip")

        def copyfile(self, source: Any, outputfile: Any) -> None:
            with suppress(OSError):  # the page was closed
                while piece := source.read(PIECE):
                    line.carry(len(piece))
                    outputfile.write(piece)

    with ThreadingHTTPServer(("127.0.0.1", 0), partial(Handler, directory=str(folder))) as server:
        server.daemon_threads = True
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}/"
        server.shutdown()


def main(stream: str) -> None:
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        site = Path(folder) / "site"
        share(stream, site, PageText("First image"))
        flags = ["--no-sandbox", "--use-angle=swiftshader"]
        browser = playwright.chromium.launch(executable_path="/usr/bin/chromium", args=flags)
        for compress in (False, True):
            for file in site.rglob("*") if compress else ():
                if file.suffix in (".html", ".js", ".json"):
                    file.write_bytes(gzip.compress(file.read_bytes()))
            for rate in RATES:
                times: list[tuple[float, float]] = []
                for _ in range(PAGES):
                    with served(site, Line(rate), compress) as address:
                        page = browser.new_context(viewport={"width": 390, "height": 844}).new_page()
                        page.add_init_script(WATCH)
                        page.goto(address, wait_until="commit")
                        page.wait_for_function("window.first && window.poster", timeout=120_000)
                        times.append(page.evaluate("[window.poster, window.first]"))
                        page.context.close()
                poster, first = (median(column) / 1000 for column in zip(*times, strict=True))
                kind = "compressed" if compress else "plain"
                print(f"{kind}, {rate} Mbit/s: poster {poster:.1f} s, first image {first:.1f} s", flush=True)
        browser.close()


if __name__ == "__main__":
    main(sys.argv[1])
