"""A local web server that answers as told."""

import hashlib
import threading
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest

from v3studio.studio.stream.sources.http import HttpSource

CONTENT = bytes(range(256)) * 800  # 204,800 bytes


def respond(handler: BaseHTTPRequestHandler, status: int, body: bytes = b"", **headers: str) -> None:
    """Send a status, headers and the beginning of a body."""
    handler.send_response(status)
    for name, value in headers.items():
        handler.send_header(name.replace("_", "-"), value)
    handler.end_headers()
    handler.wfile.write(body)


def timed(address: str, **seconds: float) -> HttpSource:
    """A source with other limits of time."""
    return type("Timed", (HttpSource,), seconds)(address)


class Server:
    """Serves `files`. A function of handler and bytes in `faults` replaces the response for its path.

    Attributes:
        requests: (path, Range header or None), in order.
        etag, ranges: whether it sends tags, and answers range requests.
    """

    def __init__(self) -> None:
        self.files: dict[str, bytes] = {"/s/file": CONTENT}
        self.faults: dict[str, Callable] = {}
        self.requests: list[tuple[str, str | None]] = []
        self.etag = self.ranges = True
        self.stop_stalling = threading.Event()
        outer = self

        class Handler(BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"

            def do_GET(self) -> None:
                path = self.path.split("?")[0]
                outer.requests.append((self.path, self.headers.get("Range")))
                data = outer.files.get(path)
                fault = outer.faults.get(path)
                if fault is not None:
                    fault(self, data)
                elif data is None:
                    self.send_error(404)
                else:
                    self.answer(data)

            def answer(self, data: bytes, say: int | None = None, send: int | None = None) -> None:
                """The file or the requested range; declare the length `say`, send only `send` bytes and close."""
                start, end = 0, len(data) - 1
                tag = f'"{hashlib.sha256(data).hexdigest()[:16]}"'
                asked = self.headers.get("Range")
                if asked == f"bytes={len(data)}-":
                    return self.send_error(416)
                if asked is not None and outer.ranges and self.headers.get("If-Range") in (None, tag):
                    start, end = (int(part or end) for part in asked.removeprefix("bytes=").split("-"))
                    self.send_response(206)
                    self.send_header("Content-Range", f"bytes {start}-{end}/{len(data)}")
                else:
                    self.send_response(200)
                body = data[start : end + 1]
                self.send_header("Content-Length", str(len(body) if say is None else say))
                if outer.etag:
                    self.send_header("ETag", tag)
                self.end_headers()
                self.wfile.write(body[:send])
                if send is not None or say is not None:
                    self.close_connection = True
                return None

            def log_message(self, *arguments: object) -> None:
                pass

        self.server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.server.daemon_threads = True
        self.server.handle_error = lambda *_: None  # clients disconnect when they have seen enough
        self.url = f"http://127.0.0.1:{self.server.server_address[1]}/s"
        threading.Thread(target=self.server.serve_forever, args=(0.01,), daemon=True).start()

    def close(self) -> None:
        self.stop_stalling.set()
        self.server.shutdown()
        self.server.server_close()


@pytest.fixture
def server() -> Iterator[Server]:
    server = Server()
    yield server
    server.close()
