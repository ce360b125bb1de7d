"""A web server that can be slow, fail and recover, and a page with the player, controlled from Python."""

from __future__ import annotations

import base64
import re
import socket
import threading
import time
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import numpy as np

PATIENCE = 120_000  # milliseconds; the machine may be busy
TYPES = {
    ".html": "text/html",
    ".js": "text/javascript",
    ".mjs": "text/javascript",
    ".json": "application/json",
    ".mp4": "video/mp4",
    ".m4a": "audio/mp4",
}


class Site:
    """Serves a folder with range requests.

    Attributes:
        bytes_per_second: rate limit; None for no limit.
        cut: {path suffix: bytes}: the connection is closed after this many bytes of the body, once `break_off` is set.
        requests: (path, range header) of all requests.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.bytes_per_second: float | None = None
        self.cut: dict[str, int] = {}
        self.break_off = threading.Event()
        self.requests: list[tuple[str, str | None]] = []
        site = self

        class Handler(BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"

            def log_message(self, *_arguments: Any) -> None:
                pass

            def do_GET(self) -> None:
                site._answer(self)

        class Server(ThreadingHTTPServer):
            daemon_threads = True

            def handle_error(self, *_arguments: Any) -> None:
                pass  # a browser that disconnects is not an error

        self._server = Server(("0.0.0.0", 0), Handler)
        self.port: int = self._server.server_port
        self._thread = threading.Thread(target=self._server.serve_forever, daemon=True)

    @property
    def stream(self) -> Path:
        return self.folder / "stream"

    def __enter__(self) -> Site:
        self._thread.start()
        return self

    def __exit__(self, *_error: object) -> None:
        self._server.shutdown()
        self._server.server_close()

    def _answer(self, handler: BaseHTTPRequestHandler) -> None:
        path = handler.path.split("?")[0]
        wanted = handler.headers.get("Range")
        self.requests.append((path, wanted))
        file = self.folder / path.strip("/") / ("index.html" if path.endswith("/") else "")
        if not file.is_file():
            handler.send_error(404)
            return
        data = file.read_bytes()
        tag = f'"{file.stat().st_mtime_ns}-{len(data)}"'
        start, end, status = 0, len(data), 200
        match = re.fullmatch(r"bytes=(\d+)-(\d*)", wanted or "")
        if match and int(match[1]) < len(data) and handler.headers.get("If-Range", tag) == tag:
            start, status = int(match[1]), 206
            end = min(int(match[2]) + 1, len(data)) if match[2] else len(data)
        body = data[start:end]
        handler.send_response(status)
        handler.send_header("Content-Type", TYPES.get(file.suffix, "application/octet-stream"))
        handler.send_header("Content-Length", str(len(body)))
        handler.send_header("ETag", tag)
        handler.send_header("Cache-Control", "no-cache")
        handler.send_header("Accept-Ranges", "bytes")
        if status == 206:
            handler.send_header("Content-Range", f"bytes {start}-{end - 1}/{len(data)}")
        handler.end_headers()
        limit = next((size for ending, size in self.cut.items() if path.endswith(ending)), None)
        if limit is not None and not self.break_off.is_set():
            handler.wfile.write(body[:limit])
            handler.wfile.flush()
            self.break_off.wait(PATIENCE / 1000)
            handler.close_connection = True
            handler.connection.shutdown(socket.SHUT_RDWR)
            return
        if self.bytes_per_second is None:
            handler.wfile.write(body)
            return
        piece = max(256, int(self.bytes_per_second / 20))
        for at in range(0, len(body), piece):
            handler.wfile.write(body[at : at + piece])
            handler.wfile.flush()
            time.sleep(piece / self.bytes_per_second)


PREPARE = """() => {
  const element = document.querySelector('v3-player');
  if (element === null) return;  // a page that leads to players
  window.seen = {};
  const names = ['ready', 'opened', 'play', 'pause', 'time', 'view', 'waiting', 'ended', 'looped',
    'notice', 'updated', 'error'];
  for (const name of names)
    element.addEventListener('v3-' + name, ({detail}) => { (window.seen[name] ??= []).push(detail); });
  window.text = pixels => {
    let text = '';
    for (let i = 0; i < pixels.length; i += 32768)
      text += String.fromCharCode.apply(null, pixels.subarray(i, i + 32768));
    return btoa(text);
  };
}"""


_BOUNDED = f"""async (run, argument) => {{
  let timer;
  const late = new Promise((_, failed) => {{
    timer = setTimeout(() => failed(new Error(`no result after {PATIENCE} ms: ${{run}}`)), {PATIENCE});
  }});
  try {{ return await Promise.race([run(argument), late]); }} finally {{ clearTimeout(timer); }}
}}"""


PICTURE = """([camera, background]) => new Promise(done => {
  const {engine} = document.querySelector('v3-player'), {canvas, screen} = engine, before = engine.background;
  let taken = false;
  engine.on('rendered', () => {
    if (taken || !screen.sharp || engine.sorting) return;
    taken = true;
    const {gl} = screen.renderer, {width, height} = canvas, pixels = new Uint8Array(4 * width * height);
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
    canvas.style.width = canvas.style.height = '';
    engine.fixedCamera = null;
    engine.background = before;
    done(text(pixels));
  });
  canvas.style.width = `${camera.width}px`;
  canvas.style.height = `${camera.height}px`;
  engine.background = background;
  engine.fixedCamera = camera;
})"""


class Page:
    """The player's page. `seen` contains the details of the element's events by name.

    Attributes:
        errors, requests: what the page's scripts threw, and the addresses it requested.
    """

    def __init__(self, handle: Any) -> None:
        self.handle = handle
        self.errors: list[str] = []
        self.requests: list[str] = []
        handle.on("request", lambda request: self.requests.append(request.url))
        handle.on("pageerror", lambda error: self.errors.append(str(error)))
        handle.add_init_script(f"document.addEventListener('DOMContentLoaded', {PREPARE})")
        handle.set_default_timeout(PATIENCE)
        self._session = handle.context.new_cdp_session(handle)

    def leave(self) -> None:
        """Back to an empty page, as before it was opened."""
        storage = {"origin": self.evaluate("() => origin"), "storageTypes": "all"}
        self._session.send("Storage.clearDataForOrigin", storage)
        self.handle.unroute_all()
        self.handle.mouse.move(-1, -1)
        self.handle.goto("about:blank")
        self.errors.clear()
        self.requests.clear()

    def evaluate(self, script: str, argument: Any = None) -> Any:
        """The result of a JavaScript function for the argument; a promise that stays open for `PATIENCE` fails."""
        return self.handle.evaluate(f"argument => ({_BOUNDED})({script}, argument)", argument)

    def wait(self, condition: str, argument: Any = None) -> None:
        """Wait until a JavaScript expression over `player` (the element) and `seen` is true."""
        names = "player = document.querySelector('v3-player'), seen = window.seen"
        self.handle.wait_for_function(f"argument => {{ const {names}; return !!({condition}); }}", arg=argument)

    def wait_ready(self) -> None:
        """Wait for the first picture and the controls. The page may still be the one before it."""
        self.wait("(player?.state?.ready && player.ui) || (seen?.error ?? []).length")
        assert not self.seen("error"), self.seen("error")

    def seen(self, name: str) -> list[Any]:
        return self.evaluate("name => window.seen[name] ?? []", name)

    @property
    def state(self) -> dict[str, Any]:
        return self.evaluate("() => document.querySelector('v3-player').state")

    def call(self, method: str, *arguments: Any) -> Any:
        return self.evaluate(
            "([method, values]) => document.querySelector('v3-player')[method](...values)", [method, list(arguments)]
        )

    def click(self, act: str) -> None:
        """Press a button in the control bar."""
        self.handle.locator(f"v3-player .bar [data-act='{act}']").click()

    def touch(self, kind: str, points: list[tuple[float, float]], at: float | None = None) -> None:
        """Send a touch event: touchStart, touchMove or touchEnd. `at`: its time in seconds instead of now."""
        places = [{"x": x, "y": y, "id": number} for number, (x, y) in enumerate(points)]
        when = {} if at is None else {"timestamp": at}
        self._session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": places, **when})

    def swipe(self, *fingers: tuple[tuple[float, float], tuple[float, float]]) -> None:
        """Move each finger by (dx, dy) from where it touches, in steps."""
        self.touch("touchStart", [start for start, _ in fingers])
        for step in range(1, 9):
            self.touch("touchMove", [(x + dx * step / 8, y + dy * step / 8) for (x, y), (dx, dy) in fingers])
        self.touch("touchEnd", [])

    def seek_frame(self, frame: int) -> None:
        """Pause, go to a frame and wait until it is shown."""
        self.call("pause")
        self.evaluate(
            """frame => new Promise((done, failed) => {
              const engine = document.querySelector('v3-player').engine;
              engine.on('seeked', event => { if (event.frame === frame) done(); });
              engine.on('failed', failed);
              engine.seekFrame(frame);
            })""",
            frame,
        )

    def picture(self, camera: dict[str, Any], background: tuple[float, float, float] = (0, 0, 0)) -> np.ndarray:
        """(H, W, 3) uint8: the current frame on the paused player's canvas, from a camera, once nothing changes."""
        text = self.evaluate(PICTURE, [camera, list(background)])
        pixels = np.frombuffer(base64.b64decode(text), np.uint8)
        return pixels.reshape(camera["height"], camera["width"], 4)[::-1, :, :3]


OpenPage = Callable[..., Page]
Baked = Callable[..., Path]


def psnr(a: np.ndarray, b: np.ndarray) -> float:
    """PSNR of two uint8 images in dB."""
    error = float(((a.astype(np.float64) - b) ** 2).mean())
    return float(10 * np.log10(255**2 / max(error, 1e-10)))
