import logging
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest

from tests.support.waiting import wait_until
from tests.support.web_servers import ask
from v3studio.pipelines.share.server import BoundedLog, BoundedServer, Limits, listen
from v3studio.pipelines.share.web_app import build_app, is_allowed, usable_range

QUICK = Limits(connections=4, request=0.5, idle=0.3, stall=0.5, handshake=0.5)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("served")
    (folder / "manifest.json").write_text("{}")
    (folder / "big.bin").write_bytes(bytes(30_000_000))
    return folder


@contextmanager
def bounded(folder: Path, limits: Limits, **options: object) -> Iterator[tuple[int, BoundedServer]]:
    with listen("127.0.0.1", 0) as sock:
        app = build_app({"/": folder}, **options)  # type: ignore[arg-type]
        server = BoundedServer(app, limits=limits)
        thread = threading.Thread(target=server.run, kwargs={"sockets": [sock]})
        thread.start()
        try:
            yield sock.getsockname()[1], server
        finally:
            server.should_exit = True
            thread.join(120)


def connected(port: int, sent: bytes = b"") -> socket.socket:
    client = socket.create_connection(("127.0.0.1", port), timeout=120)
    client.sendall(sent)
    return client


def until_closed(client: socket.socket) -> bytes:
    data = b""
    try:
        while part := client.recv(65536):
            data += part
    except ConnectionResetError:
        pass
    return data


def test_beyond_the_limit_clients_are_told_and_served_again_when_others_have_gone(folder: Path) -> None:
    with bounded(folder, replace(QUICK, request=60, idle=60)) as (port, server):
        silent = [connected(port) for _ in range(4)]
        assert ask(port, "/manifest.json")[0] == 503
        for client in silent:
            client.close()
        wait_until("all connections are closed", lambda: not server.open)
        assert ask(port, "/manifest.json")[0] == 200


BODY = b"GET /manifest.json HTTP/1.1\r\nHost: localhost\r\nContent-Length: 1000000\r\n\r\nx"


@pytest.mark.parametrize(
    ("start", "code"), [(b"", b"408"), (b"GET / HTTP/1.1\r\nHost", b"408"), (b"\x16\x03\x01", b"400"), (BODY, b"200")]
)
def test_a_request_that_does_not_come_is_not_awaited(folder: Path, start: bytes, code: bytes) -> None:
    with bounded(folder, QUICK) as (port, _), connected(port, start) as client:
        answer = until_closed(client)
        assert answer == b"" or answer.startswith((b"HTTP/1.1 408", b"HTTP/1.1 " + code))


def test_bytes_that_drip_renew_no_deadline(folder: Path) -> None:
    request = b"GET /manifest.json HTTP/1.1\r\nHost: localhost\r\nX: " + b"x" * 10_000
    with bounded(folder, QUICK) as (port, _), connected(port) as client:
        client.settimeout(0.05)
        answer = b""
        for byte in request:
            try:
                client.send(bytes([byte]))
                answer = client.recv(1000)
                break
            except TimeoutError:
                continue
            except OSError:
                break
        assert answer == b"" or answer.startswith(b"HTTP/1.1 408")


def test_clients_that_do_not_read_are_dropped(folder: Path) -> None:
    with bounded(folder, QUICK) as (port, server):
        client = connected(port, b"GET /big.bin HTTP/1.1\r\nHost: localhost\r\n\r\n")
        assert client.recv(10)
        wait_until("the connection is dropped", lambda: not server.open)
        client.close()


OURS = ("localhost:8000", "127.0.0.1", "192.168.0.7:8000", "[::1]:8000", "[fe80::1%eth0]", "studio.localhost")
OURS += ("Studio:80", "studio.")
OTHERS = ("", "evil.example", "evil.example:8000", "127.0.0.1.evil.example", "localhost.evil.example", "studio.evil")


def test_names_of_others_are_refused() -> None:
    assert [host for host in (*OTHERS, *OURS) if is_allowed(host, ("studio",))] == [*OURS]


def test_secret_paths_names_and_origins(folder: Path) -> None:
    with bounded(folder, Limits(), secret="s3cret", origins=["https://player.example"]) as (port, _):
        assert ask(port, "/s3cret/manifest.json")[0] == 200
        for path in ("/manifest.json", "/", "/s3cre/manifest.json", "/S3cret/manifest.json", "//s3cret/manifest.json"):
            assert ask(port, path)[0] == 404
        other = b"GET /s3cret/manifest.json HTTP/1.1\r\nHost: evil.example\r\nConnection: close\r\n\r\n"
        with connected(port, other) as client:
            assert until_closed(client).startswith(b"HTTP/1.1 421")
        allowed = "access-control-allow-origin"
        assert ask(port, "/s3cret/manifest.json", Origin="https://player.example")[1][allowed]
        assert allowed not in ask(port, "/s3cret/manifest.json", Origin="https://other.example")[1]
    with bounded(folder, Limits()) as (port, _):
        assert allowed not in ask(port, "/manifest.json", Origin="https://player.example")[1]
        for wrong in ("bytes=5-2", "bytes=x", "lines=1-2", "bytes=", "bytes=1-2-3", "0-1"):
            assert ask(port, "/manifest.json", Range=wrong)[::2] == (200, b"{}")
        assert ask(port, "/manifest.json", Range="bytes=1-")[::2] == (206, b"}")


def test_many_ranges_are_ignored() -> None:
    assert usable_range(b"bytes=0-1, 4-5,-3")
    assert not usable_range(b"bytes=" + b",".join(b"0-1" for _ in range(1000)))
    assert not usable_range(b"bytes=0-" + b"9" * 5000)


def test_logs_are_bounded() -> None:
    now = [0.0]
    log = BoundedLog(3, 60, lambda: now[0])
    records = [logging.LogRecord("x", logging.ERROR, "", 0, "bad", None, None) for _ in range(10)]
    assert sum(log.filter(record) for record in records) == 3
    now[0] = 61
    last = logging.LogRecord("x", logging.ERROR, "", 0, "bad", None, None)
    assert log.filter(last)
    assert last.getMessage() == "(7 messages left out) bad"
