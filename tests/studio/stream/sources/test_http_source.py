"""HTTP reads from a local server that stalls, disconnects, sends wrong data and restarts."""

import contextlib
import hashlib
import threading
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest
import torch

from studio.stream import SourceUnavailable, StreamReader
from studio.stream.sources.http import HttpSource
from tests.support.errors import refuses

CONTENT = bytes(range(256)) * 800  # 204,800 bytes


def respond(handler: BaseHTTPRequestHandler, status: int, body: bytes = b"", **headers: str) -> None:
    """Send a status, headers and the beginning of a body."""
    handler.send_response(status)
    for name, value in headers.items():
        handler.send_header(name.replace("_", "-"), value)
    handler.end_headers()
    handler.wfile.write(body)


class Server:
    """Serves `files`. A function of handler and bytes in `faults` replaces the response for its path.

    Attributes:
        requests: (path, Range header or None), in order.
    """

    def __init__(self, port: int = 0) -> None:
        self.files: dict[str, bytes] = {"/s/file": CONTENT}
        self.faults: dict[str, Callable] = {}
        self.requests: list[tuple[str, str | None]] = []
        self.etag = True
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
                start = 0
                tag = f'"{hashlib.sha256(data).hexdigest()[:16]}"'
                asked = self.headers.get("Range")
                if asked == f"bytes={len(data)}-":
                    return self.send_error(416)
                if asked is not None and self.headers.get("If-Range") in (None, tag):
                    start = int(asked.removeprefix("bytes=").removesuffix("-"))
                    self.send_response(206)
                    self.send_header("Content-Range", f"bytes {start}-{len(data) - 1}/{len(data)}")
                else:
                    self.send_response(200)
                body = data[start:]
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

        self.server = ThreadingHTTPServer(("127.0.0.1", port), Handler)
        self.server.daemon_threads = True
        self.port = self.server.server_address[1]
        self.url = f"http://127.0.0.1:{self.port}/s"
        threading.Thread(target=self.server.serve_forever, args=(0.01,), daemon=True).start()

    def close(self) -> None:
        self.stop_stalling.set()
        self.server.shutdown()
        self.server.server_close()


@pytest.fixture
def server():
    server = Server()
    yield server
    server.close()


@pytest.fixture
def source(server):
    """It waits for as long as a busy machine may take."""
    source = HttpSource(server.url, stall=60, patience=60, first_patience=60)
    yield source
    source.close()


@pytest.fixture
def hasty(server):
    """For servers that never answer."""
    source = HttpSource(server.url, stall=0.3, patience=1.5, first_patience=0.5)
    yield source
    source.close()


@pytest.mark.parametrize("tail", ["", "/", "/manifest.json"])
def test_the_addresses_forms(server, tail):
    source = HttpSource(server.url + tail + "?token=a%20b")
    assert source.read("file", 10**6) == CONTENT
    assert server.requests == [("/s/file?token=a%20b", None)]
    assert "token" not in source.name


def test_name_and_password_go_into_a_header_only(server):
    seen = []
    server.faults["/s/file"] = lambda handler, data: (
        seen.append(handler.headers["Authorization"]),
        handler.answer(data),
    )
    source = HttpSource(server.url.replace("http://", "http://me:se%3Acret@"))
    assert source.read("file", 10**6) == CONTENT
    assert seen == ["Basic bWU6c2U6Y3JldA=="]
    assert "secret" not in source.name
    assert "se%3Acret" not in source.name


@pytest.mark.parametrize("address", ["ftp://host/x", "http://", "http://host:port/", "host/x"])
def test_no_address(address):
    with refuses("source.invalid_url", file=address):
        HttpSource(address)


def test_broken_connections_go_on_where_they_ended(server, source):
    cuts = iter([50_000, 100, 90_000])
    server.faults["/s/file"] = lambda handler, data: handler.answer(data, send=next(cuts, None))
    assert source.read("file", len(CONTENT)) == CONTENT
    assert [asked for _, asked in server.requests] == [None, "bytes=50000-", "bytes=50100-", "bytes=140100-"]


def test_a_file_that_changes_meanwhile_is_never_mixed(server, source):
    new = CONTENT[::-1]

    def cut_then_change(handler, data):
        handler.answer(data, send=70_000)
        server.files["/s/file"] = new
        del server.faults["/s/file"]

    server.faults["/s/file"] = cut_then_change
    assert source.read("file", len(CONTENT)) == new


def test_a_file_that_shrinks_meanwhile_is_read_again(server, source):
    """By a server that knows no If-Range: it has nothing from that place on, and says so."""
    new = CONTENT[:50_000]

    def cut(handler, data):
        handler.answer(data, send=70_000)
        server.faults["/s/file"] = shrunk

    def shrunk(handler, data):
        asked = handler.headers.get("Range")
        if asked is None:
            handler.answer(new)
        else:
            handler.send_error(416)

    server.faults["/s/file"] = cut
    assert source.read("file", len(CONTENT)) == new
    assert [asked for _, asked in server.requests] == [None, "bytes=70000-", None]


def test_a_stalling_server(server, hasty):
    def stall(handler, data):
        respond(handler, 200, data[:1000], Content_Length=str(len(data)))
        server.stop_stalling.wait(60)

    server.faults["/s/file"] = stall
    with refuses("source.unavailable", file=f"{server.url}/file", reason="read_timeout"):
        hasty.read("file", len(CONTENT))


def test_a_trickle_is_no_stream(server):
    def trickle(handler, data):
        respond(handler, 200, Content_Length=str(len(data)))
        for byte in range(2000):
            if server.stop_stalling.wait(0.05):
                return
            handler.wfile.write(data[byte : byte + 1])

    server.faults["/s/file"] = trickle
    with (
        contextlib.closing(HttpSource(server.url, stall=3, patience=1.5)) as source,
        refuses("source.unavailable", reason="too_slow"),
    ):
        source.read("file", len(CONTENT))


def test_a_length_above_the_limit_is_refused_before_anything_is_read(server, source):
    server.faults["/s/file"] = lambda handler, data: handler.answer(data, say=10**12)
    with refuses("source.file_too_long", file=f"{server.url}/file", value=10**12, expected=5):
        source.read("file", 5)
    assert len(server.requests) == 1


def test_more_than_the_limit_without_a_length(server, source):
    def endless(handler, data):
        respond(handler, 200, Connection="close")
        handler.close_connection = True
        try:
            while not server.stop_stalling.is_set():
                handler.wfile.write(data)
        except OSError:
            server.stop_stalling.set()  # the client disconnected

    server.faults["/s/file"] = endless
    with refuses("source.file_too_long", file=f"{server.url}/file", expected=1000):
        source.read("file", 1000)
    assert server.stop_stalling.wait(60)


def test_a_length_that_is_too_long_or_too_short(server, source, hasty):
    server.faults["/s/file"] = lambda handler, data: handler.answer(data, say=len(data) + 5)
    with pytest.raises(SourceUnavailable) as caught:
        hasty.read("file", len(CONTENT) + 5)
    assert caught.value.fields["reason"] in ("connection_closed", "connection_broken", "file_changed", "read_timeout")
    server.faults["/s/file"] = lambda handler, data: handler.answer(data, say=len(data) - 5)
    assert source.read("file", len(CONTENT)) == CONTENT[:-5]  # the reader then sees that 5 bytes are missing


@pytest.mark.parametrize(
    ("status", "code"),
    [
        (404, "source.file_missing"),
        (403, "source.access_denied"),
        (400, "source.http_status"),
        (304, "source.http_status"),
    ],
)
def test_answers_that_do_not_pass(server, source, status, code):
    server.faults["/s/file"] = lambda handler, data: handler.send_error(status)
    with refuses(code, file=f"{server.url}/file", status=status):
        source.read("file", 10)
    assert len(server.requests) == 1


@pytest.mark.parametrize("status", [500, 503, 429])
def test_answers_that_pass(server, status):
    def later(handler, data):
        if len(server.requests) == 3:
            server.faults.clear()
        respond(handler, status, Retry_After="0", Content_Length="0")

    server.faults["/s/file"] = later
    with contextlib.closing(HttpSource(server.url, patience=60)) as source:
        assert source.read("file", len(CONTENT)) == CONTENT
    assert len(server.requests) == 4


def test_compression_is_refused(server, source):
    answer = {"Content_Encoding": "gzip", "Content_Length": "3"}
    server.faults["/s/file"] = lambda handler, data: respond(handler, 200, b"abc", **answer)
    with refuses("source.compressed", value="gzip"):
        source.read("file", 10)


def test_redirections_are_followed_but_not_in_circles(server, source):
    def elsewhere(handler, data):
        respond(handler, 302, Location=handler.path.replace("moved", "file"), Content_Length="0")

    server.faults["/s/moved"] = elsewhere
    assert source.read("moved", len(CONTENT)) == CONTENT
    server.faults["/s/file"] = elsewhere
    with refuses("source.redirect_loop"):
        source.read("file", 10)


def test_nobody_there(server):
    server.close()
    with refuses("source.unavailable", reason="no_connection"):
        HttpSource(server.url, first_patience=0.4).read("file", 10)


def upload(server, folder) -> None:
    for path in folder.rglob("*"):
        if path.is_file():
            server.files["/s/" + path.relative_to(folder).as_posix()] = path.read_bytes()


def test_a_stream_is_the_same_as_from_its_folder(server, intact):
    folder = intact("ladder")
    upload(server, folder)
    with StreamReader.open(folder) as local, StreamReader.open(server.url) as remote:
        assert remote.manifest == local.manifest
        for mine, theirs in zip(local.iterate(), remote.iterate(), strict=True):
            assert all(torch.equal(a, b) for (_, a), (_, b) in zip(mine.items(), theirs.items(), strict=True))
        remote.verify()


def test_no_stream_at_the_address(server):
    with refuses("source.file_missing", file=f"{server.url}/manifest.json", status=404):
        StreamReader.open(server.url)
    with refuses("source.unsupported_url", file="ftp://somewhere/x"):
        StreamReader.open("ftp://somewhere/x")


def test_a_file_that_is_the_same_is_not_sent_again(server, source):
    def conditional(handler, data):
        tag = f'"{hashlib.sha256(data).hexdigest()[:16]}"'
        if handler.headers.get("If-None-Match") != tag:
            return handler.answer(data)
        return respond(handler, 304)

    server.faults["/s/file"] = conditional
    assert source.read_changed("file", 10**6) == CONTENT
    assert source.read_changed("file", 10**6) is None
    server.files["/s/file"] = b"other"
    assert source.read_changed("file", 10**6) == b"other"
    server.etag = False
    server.files["/s/file"] = b"third"
    assert source.read_changed("file", 10**6) == b"third"
    assert source.read_changed("file", 10**6) == b"third"
