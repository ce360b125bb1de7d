"""Plays mutated streams in a browser: no hang, no crash, no more memory, and a sentence for each that is refused.

    python benchmarks/hostile_streams.py STREAM [--count 1000] [--first 0] [--browser /usr/bin/chromium]

Each mutation changes the manifest, a side file (compressed, or its content) or a video of a stream of the profile
`motion` (of version 2, or of version 3 without pages), and then updates all sizes and checksums, as a malicious writer
would. All are played one after the other in one page, that is, in one process with one player. Mutation N is always the
same, so that a failure can be repeated with `--first N --count 1`.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import random
import sys
import threading
import time
import zlib
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

Files = dict[str, bytes]
"""A stream's files by their path in it."""

MANIFEST = "manifest.json"
FLAGS = ["--no-sandbox", "--disable-background-networking", "--no-first-run", "--js-flags=--expose-gc"]
PATIENCE = 60.0
"""Seconds in which a mutated stream must be refused or played."""

VALUES: list[Any] = [
    *(None, True, False, 0, -1, 1, 7, 255, 65536, 2**31, 2**53, 1e300, -1e9, 1e-300),
    *("", "x", "../x", [], {}, [[]]),
]
PAGE = b"<!doctype html><script type='module' src='v3-player.js'></script>"

OPEN = """decoder => {
  window.player = document.createElement('v3-player');
  player.style.cssText = 'width: 100px; height: 100px';
  player.setAttribute('loop', '');
  player.setAttribute('decoder', decoder);
  document.body.append(player);
}"""

PLAY = """async ([url, patience]) => {
  let outcome = null;
  const stop = new AbortController(), signal = stop.signal;
  player.addEventListener('v3-error', ({detail}) => { outcome ??= 'refused: ' + detail; }, {signal});
  let notice = null;
  player.addEventListener('v3-notice', ({detail}) => { notice ??= 'without a group: ' + detail; }, {signal});
  player.addEventListener('v3-looped', () => { outcome ??= notice ?? 'played'; }, {signal});
  player.setAttribute('src', url);
  player.play();
  player.setSpeed(4);
  const began = performance.now();
  // A single frame, or a rate near nothing, is played as well as it can be: then the first picture is enough.
  while (outcome === null && performance.now() - began < 1000 * patience) {
    await new Promise(done => setTimeout(done, 5));
    const {ready, duration, frameCount} = player.state;
    if (ready && (duration > 5 || frameCount === 1)) outcome = 'shown';
  }
  stop.abort();
  return outcome;
}"""


def read_stream(folder: Path) -> Files:
    """All files of a stream in a folder."""
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def signed(values: Any, files: Files) -> bytes:
    """The bytes of a manifest, with the total size and the checksum filled in; as good as possible for nonsense."""
    try:
        if "renditions" in values:  # each file once
            entries = [
                one[key] for group in values["groups"] for one in group["renditions"] for key in ("side", "video")
            ]
            entries += [values["audio"]] if values.get("audio") else []
            groups = sum({entry["path"]: entry["bytes"] for entry in entries}.values())
        else:
            groups = sum(group["bytes"] for group in values["groups"])
        values["manifest_sha256"] = zeros = "0" * 64
        for _ in range(5):
            data = json.dumps(values).encode()
            values["total_bytes"] = groups + len(data)
        return data.replace(zeros.encode(), hashlib.sha256(data).hexdigest().encode(), 1)
    except (TypeError, KeyError, ValueError, IndexError, AttributeError):
        return json.dumps(values).encode()


def _best(group: Any) -> Any:
    """What the manifest says of a group's best rendition; in version 2, of the group."""
    return group["renditions"][0] if "renditions" in group else group


def _with_file(files: Files, group: int, key: str, data: bytes, raw_bytes: int | None = None) -> Files:
    values = json.loads(files[MANIFEST])
    best = _best(values["groups"][group])
    entry, digest = best[key], hashlib.sha256(data).hexdigest()
    best["bytes"] += len(data) - entry["bytes"]
    entry["bytes"], entry["sha256"] = len(data), digest
    if "renditions" in values:
        entry["path"] = f"files/{digest[:32]}.{entry['path'].rpartition('.')[2]}"
    if raw_bytes is not None:
        entry["raw_bytes"] = raw_bytes
    changed = {**files, entry["path"]: data}
    return {**changed, MANIFEST: signed(values, changed)}


def _changed_bytes(rng: random.Random, data: bytes) -> bytes:
    changed = bytearray(data)
    for _ in range(rng.randint(1, 6)):
        at = rng.randrange(len(changed))
        kind = rng.randrange(4)
        if kind == 0:
            changed[at] ^= 1 << rng.randrange(8)
        elif kind == 1:
            changed[at : at + rng.randint(1, 16)] = rng.randbytes(rng.randint(0, 16))
        elif kind == 2:
            changed[at : at + 4] = rng.choice([b"\xff\xff\xff\xff", b"\0\0\0\0", b"\x7f\xff\xff\xff", b"\x80\0\0\0"])
        else:
            del changed[at : at + rng.randint(1, 200)]
        if not changed:
            changed = bytearray(b"\0")
    return bytes(changed)


def _changed_manifest(rng: random.Random, data: bytes) -> Any:
    values = at = json.loads(data)
    for _ in range(rng.randint(1, 6)):
        key = rng.choice(list(at) if isinstance(at, dict) else list(range(len(at))))
        if isinstance(at[key], dict | list) and at[key] and rng.random() < 0.85:
            at = at[key]
            continue
        at[key] = rng.choice(VALUES)
        return values
    return [values] * 2


def mutate(files: Files, number: int) -> tuple[str, Files]:
    """What mutation `number` of a stream changes, and the stream with it."""
    rng = random.Random(number)
    kind = rng.choice(["manifest", "nonsense", "side content", "side file", "video", "video"])
    if kind == "nonsense" and rng.random() < 0.8:
        kind = "manifest"
    if kind == "manifest":
        return kind, {**files, MANIFEST: signed(_changed_manifest(rng, files[MANIFEST]), files)}
    if kind == "nonsense":
        deep = rng.choice([b"[", b'{"format":'])
        return kind, {**files, MANIFEST: deep * rng.randint(1, 100_000)}
    groups = json.loads(files[MANIFEST])["groups"]
    group = rng.randrange(len(groups))
    key = "video" if kind == "video" else "side"
    data = files[_best(groups[group])[key]["path"]]
    if kind != "side content":
        return kind, _with_file(files, group, key, _changed_bytes(rng, data))
    raw = _changed_bytes(rng, zlib.decompress(data, wbits=-15))
    packer = zlib.compressobj(wbits=-15)
    return kind, _with_file(files, group, key, packer.compress(raw) + packer.flush(), len(raw))


class Host:
    """A web server for the player and one stream, in memory.

    Attributes:
        stream: its files; the URL's first folder is ignored, so that each mutation has an address of its own.
    """

    def __init__(self, player: Path) -> None:
        self.stream: Files = {}
        script = (player / "v3-player.js").read_bytes()
        host = self

        class Handler(BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"

            def log_message(self, *_arguments: Any) -> None:
                pass

            def do_GET(self) -> None:
                pages = {"/": (PAGE, "text/html"), "/v3-player.js": (script, "text/javascript")}
                data, kind = pages.get(self.path, (None, "application/octet-stream"))
                if data is None:
                    data = host.stream.get(self.path.lstrip("/").partition("/")[2])
                self.send_response(404 if data is None else 200)
                self.send_header("Content-Type", kind)
                self.send_header("Content-Length", str(len(data or b"")))
                self.end_headers()
                self.wfile.write(data or b"")

        class Server(ThreadingHTTPServer):
            daemon_threads = True

            def handle_error(self, *_arguments: Any) -> None:
                pass  # the player closes connections whose data it refuses

        self._server = Server(("127.0.0.1", 0), Handler)
        self.address = f"http://127.0.0.1:{self._server.server_port}/"
        threading.Thread(target=self._server.serve_forever, daemon=True).start()

    def close(self) -> None:
        """Stop serving."""
        self._server.shutdown()
        self._server.server_close()


@contextmanager
def hosted(player: Path) -> Iterator[Host]:
    """A `Host` for the built player in this folder, while the block runs."""
    host = Host(player)
    try:
        yield host
    finally:
        host.close()


def attack(
    page: Any, host: Host, files: Files, numbers: Iterable[int], decoder: str = "auto"
) -> Iterator[tuple[int, str, str | None]]:
    """Play mutations in a page of Playwright; yields number, kind and outcome: what the player said, "played",
    "without a group: " and the notice, "shown" (one frame), or None if it hangs."""
    page.goto(host.address)
    page.wait_for_function("!!customElements.get('v3-player')")
    page.evaluate(OPEN, decoder)
    for number in numbers:
        kind, host.stream = mutate(files, number)
        yield number, kind, page.evaluate(PLAY, [f"s{number}/", PATIENCE])


def renderer_bytes(browser: Any) -> int:
    """Resident bytes of the browser's page processes, now (Linux)."""
    found = browser.new_browser_cdp_session().send("SystemInfo.getProcessInfo")["processInfo"]
    pages = [process["id"] for process in found if process["type"] == "renderer"]
    total = 0
    for process in pages:
        for line in Path(f"/proc/{process}/status").read_text().splitlines():
            if line.startswith("VmRSS:"):
                total += int(line.split()[1]) * 1024
    return total


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("stream", type=Path)
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--browser", default="/usr/bin/chromium")
    parser.add_argument("--kind", help="only mutations of this kind, for example video")
    parser.add_argument("--decoder", default="auto", help="auto, webcodecs, webcodecs-software or video")
    arguments = parser.parse_args()
    from playwright.sync_api import sync_playwright

    from pipelines.share.player_files import player_folder

    files = read_stream(arguments.stream)
    outcomes: Counter[tuple[str, str]] = Counter()
    sentences: Counter[str] = Counter()
    failures = 0
    with hosted(player_folder()) as host, sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=arguments.browser, args=FLAGS)
        page = browser.new_page()
        began, slowest, memory = time.monotonic(), (0.0, -1), list[str]()
        last = began
        numbers = [
            number
            for number in range(arguments.first, arguments.first + arguments.count)
            if arguments.kind is None or mutate(files, number)[0] == arguments.kind
        ]
        for done, (number, kind, outcome) in enumerate(attack(page, host, files, numbers, arguments.decoder), 1):
            now = time.monotonic()
            slowest, last = max(slowest, (now - last, number)), now
            word = "hangs" if outcome is None else outcome.partition(":")[0]
            if outcome is None or (":" in outcome and not 20 < len(outcome) < 700):
                failures += 1
                print(f"mutation {number} ({kind}): {outcome}")
            outcomes[kind, word] += 1
            if outcome is not None and ":" in outcome:
                text = outcome.partition(": ")[2]
                sentences["".join("#" if c.isdigit() else c for c in text)[:60]] += 1
            if done % 100 == 0:
                page.evaluate("() => { gc(); }")
                memory.append(f"{renderer_bytes(browser) / 1e6:.0f}")
        page.evaluate("() => { gc(); }")
        heap = page.evaluate("() => performance.memory.usedJSHeapSize")
        total = f"{len(numbers)} streams in {time.monotonic() - began:.0f} s"
        print(f"{total}, slowest {slowest[0]:.1f} s (mutation {slowest[1]})")
        for (kind, word), count in sorted(outcomes.items()):
            print(f"  {kind}: {count} {word}")
        print(f"page processes after each 100 streams, MB: {', '.join(memory)}")
        print(f"JavaScript heap at the end: {heap / 1e6:.1f} MB")
        print(f"{len(sentences)} different messages; the most frequent:")
        for text, count in sentences.most_common(12):
            print(f"  {count:4d}  {text}")
        browser.close()
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
