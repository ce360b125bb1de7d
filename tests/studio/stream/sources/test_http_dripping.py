"""Servers that drip bytes, never end or break the rules, and redirects: no read outlasts its deadlines."""

import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from tests.studio.stream.sources.conftest import timed
from tests.support.errors import refuses
from v3studio.studio.errors import StudioError
from v3studio.studio.stream.sources.redirects import redirected, same_origin
from v3studio.studio.stream.sources.source import SourceUnavailable

OK = b"HTTP/1.1 200 OK\r\n"
BODY = OK + b"Content-Length: 100000\r\n\r\n"
CHUNKED = OK + b"Transfer-Encoding: chunked\r\n\r\n"
DRIPS = {
    "status line": (b"", b"H"),
    "headers": (OK + b"X: ", b"x"),
    "endless headers": (OK, b"X: y\r\n"),
    "1xx": (b"", b"HTTP/1.1 100 Continue\r\n\r\n"),
    "chunk size": (CHUNKED, b"0"),
    "chunk extension": (CHUNKED + b"5;", b"x"),
    "chunk size, then closed": (OK + b"Connection: close\r\nTransfer-Encoding: chunked\r\n\r\n", b"0"),
    "body": (BODY + b"x" * 1000, b""),
    "body, a few bytes per second": (BODY, b"x"),
    "trailer": (CHUNKED + b"2\r\n{}\r\n0\r\nX: ", b"x"),
    "nothing": (b"", b""),
}


@contextmanager
def dripping(first: bytes, drip: bytes) -> Iterator[int]:
    """A server that sends `first`, then `drip` again and again."""
    stop = threading.Event()

    def serve(client: socket.socket) -> None:
        with client:
            try:
                client.recv(10_000)
                client.sendall(first)
                while not stop.wait(0.02):
                    client.sendall(drip)
            except OSError:
                pass

    def accept(sock: socket.socket) -> None:
        while not stop.is_set():
            try:
                client, _ = sock.accept()
            except OSError:
                return
            threading.Thread(target=serve, args=(client,), daemon=True).start()

    with socket.create_server(("127.0.0.1", 0)) as sock:
        threading.Thread(target=accept, args=(sock,), daemon=True).start()
        try:
            yield sock.getsockname()[1]
        finally:
            stop.set()


@pytest.mark.parametrize("phase", DRIPS)
def test_every_phase_has_a_deadline(phase: str) -> None:
    stall = 3 if phase.endswith("second") else 0.3  # a busy server may pause between two drips
    with dripping(*DRIPS[phase]) as port:
        source = timed(f"http://127.0.0.1:{port}/", stall=stall, patience=0.3, first_patience=0.3)
        with pytest.raises(SourceUnavailable) as caught:
            source.read("manifest.json", 100_000)
    if phase.startswith("body"):
        assert caught.value.fields["reason"] == ("read_timeout" if phase == "body" else "too_slow")


BROKEN = {
    "headers without end": (OK, b"X: y\r\n" * 1000),
    "a header without end": (OK + b"X: ", b"x" * 65536),
    "a chunk size without end": (CHUNKED, b"0" * 65536),
    "a chunk of 2^60 bytes": (CHUNKED + b"FFFFFFFFFFFFFFF\r\n", b"x" * 65536),
    "a negative chunk size": (CHUNKED + b"-5\r\nabc\r\n", b""),
    "a chunk size that is no number": (CHUNKED + b"what\r\nabc\r\n", b""),
    "trailers without end": (CHUNKED + b"0\r\n", b"X: y\r\n" * 1000),
    "a negative length": (OK + b"Content-Length: -5\r\n\r\n{}", b""),
    "a length that is no number": (OK + b"Content-Length: many\r\n\r\n{}", b""),
    "two lengths": (OK + b"Content-Length: 2\r\nContent-Length: 99999\r\n\r\n{}", b""),
    "not HTTP": (b"220 smtp.example ESMTP\r\n", b""),
    "binary": (bytes(range(256)) * 100, b""),
    "an impossible status": (b"HTTP/1.1 99999 What\r\nContent-Length: 0\r\n\r\n", b""),
    "control characters": (b"HTTP/1.1 404 \x1b[2J\x1b[31m\x07\r\nContent-Length: 0\r\n\r\n", b""),
    "a redirect to nowhere": (b"HTTP/1.1 302 Found\r\nContent-Length: 0\r\n\r\n", b""),
    "a redirect of 60 KB": (b"HTTP/1.1 302 Found\r\nLocation: /" + b"a" * 60000 + b"\r\n\r\n", b""),
    "another range": (b"HTTP/1.1 206 Part\r\nContent-Range: bytes 5-6/9\r\nContent-Length: 2\r\n\r\n{}", b""),
    "no retry": (b"HTTP/1.1 429 Slow\r\nRetry-After: NaN\r\nContent-Length: 0\r\n\r\n", b""),
}


@pytest.mark.parametrize("answer", BROKEN)
def test_answers_against_the_rules_are_one_short_sentence(answer: str) -> None:
    with dripping(*BROKEN[answer]) as port:
        source = timed(f"http://127.0.0.1:{port}/", stall=0.3, patience=0.3, first_patience=0.3)
        with pytest.raises(StudioError) as caught:
            source.read("manifest.json", 1000)
        assert len(str(caught.value)) < 3000
        assert str(caught.value).isprintable()


@pytest.mark.parametrize("phase", ["status line", "chunk size", "nothing"])
def test_closing_ends_every_phase(phase: str) -> None:
    with dripping(*DRIPS[phase]) as port:
        source = timed(f"http://127.0.0.1:{port}/", stall=600, patience=600, first_patience=600)
        closing = threading.Timer(0.2, source.close)
        closing.start()
        with refuses("source.closed"):
            source.read("manifest.json", 1000)


@pytest.mark.parametrize(
    ("url", "location"),
    [
        ("https://93.184.215.14/a", "http://93.184.215.14/b"),
        ("http://93.184.215.14/a", "http://127.0.0.1/b"),
        ("http://93.184.215.14/a", "//10.0.0.1/b"),
        ("http://93.184.215.14/a", "http://[::1]/b"),
        ("http://93.184.215.14/a", "http://169.254.169.254/latest"),
        ("http://93.184.215.14/a", "file:///etc/passwd"),
        ("http://93.184.215.14/a", "http://[broken/"),
    ],
)
def test_redirects_that_are_not_followed(url: str, location: str) -> None:
    with refuses("source.unsafe_redirect"):
        redirected(url, location, url)


def test_redirects_carry_neither_query_nor_credentials_elsewhere() -> None:
    assert redirected("http://127.0.0.1/a?key=1", "/b", "") == "http://127.0.0.1/b"
    assert redirected("http://93.184.215.14/a", "https://93.184.215.15/b", "") == "https://93.184.215.15/b"
    assert same_origin("http://a/x", "http://a:80/y")
    for other in ("https://a/", "http://b/", "http://a:8000/"):
        assert not same_origin("http://a/", other)
