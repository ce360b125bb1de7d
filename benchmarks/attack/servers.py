"""Servers on the loopback interface that do what no honest server does, read by `StreamReader`."""

from __future__ import annotations

import gzip
import socket
import struct
import threading
import time
import traceback
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from outcome import Outcome

from studio.errors import StudioError
from studio.stream import BakeSettings, StreamReader
from studio.stream.sources.http import HttpSource
from tests.support.streams import bake_numbered

LIMIT = 100.0
"""Seconds in which each must be given up: 30 s of retries, and an attempt of 8 s per phase of the last."""

OK = b"HTTP/1.1 200 OK\r\n"
CHUNKED = OK + b"Transfer-Encoding: chunked\r\n\r\n"
Say = Callable[[bytes], None]
Behavior = Callable[[Say, str], None]


def once(data: bytes) -> Behavior:
    """Sends something and closes."""
    return lambda say, path: say(data)


def drip(start: bytes, rest: bytes, seconds: float = 0.2) -> Behavior:
    """Sends the start at once and then the rest byte by byte, over and over."""

    def behavior(say: Say, path: str) -> None:
        say(start)
        while True:
            for byte in rest:
                say(bytes([byte]))
                time.sleep(seconds)

    return behavior


def endless(start: bytes, rest: bytes) -> Behavior:
    """Sends the rest over and over, as fast as it is taken."""

    def behavior(say: Say, path: str) -> None:
        say(start)
        while True:
            say(rest)

    return behavior


def silent(start: bytes) -> Behavior:
    """Sends something and keeps the connection open."""

    def behavior(say: Say, path: str) -> None:
        say(start)
        time.sleep(3 * LIMIT)

    return behavior


def body(content: bytes, headers: bytes = b"") -> bytes:
    """A whole answer."""
    return OK + headers + b"Content-Length: %d\r\n\r\n" % len(content) + content


def redirect(to: bytes) -> Behavior:
    """Answers with a redirect."""
    return once(b"HTTP/1.1 302 Found\r\nLocation: " + to + b"\r\nContent-Length: 0\r\n\r\n")


def counting() -> Behavior:
    """Every answer is a redirect to another address."""
    numbers = iter(range(10**9))
    return lambda say, path: redirect(b"/%d/manifest.json" % next(numbers))(say, path)


def on_files(stream: Path, behavior: Behavior) -> Behavior:
    """The manifest of an honest stream, and another behavior for its files."""

    def served(say: Say, path: str) -> None:
        if path.endswith("manifest.json"):
            say(body((stream / "manifest.json").read_bytes()))
        else:
            behavior(say, path)

    return served


def behaviors(stream: Path) -> dict[str, Behavior]:
    """All, by name."""
    big = b"x" * 65536
    found: dict[str, Behavior] = {
        "says nothing": silent(b""),
        "status line drips": drip(b"HTTP/1.1 2", b"0"),
        "headers drip": drip(OK + b"X: ", b"y"),
        "endless headers": endless(OK, b"X: y\r\n" * 1000),
        "one header without end": endless(OK + b"X: ", big),
        "a status line without end": endless(b"HTTP/1.1 200 ", big),
        "endless 1xx answers": endless(b"", b"HTTP/1.1 100 Continue\r\n\r\n" * 100),
        "1xx answers drip": drip(b"", b"HTTP/1.1 102 Processing\r\n\r\n", 0.1),
        "the chunk size drips": drip(CHUNKED, b"0"),
        "a chunk size without end": endless(CHUNKED, b"0" * 65536),
        "a chunk of 2^60 bytes": endless(CHUNKED + b"FFFFFFFFFFFFFFF\r\n", big),
        "a negative chunk size": once(CHUNKED + b"-5\r\nabc\r\n"),
        "a chunk size that is no number": once(CHUNKED + b"what\r\nabc\r\n"),
        "endless chunks": endless(CHUNKED, b"10000\r\n" + big + b"\r\n"),
        "endless chunk extensions": endless(CHUNKED + b"5;", b"a=b;" * 10000),
        "endless trailers": endless(CHUNKED + b"0\r\n", b"X: y\r\n" * 1000),
        "trailers drip": drip(CHUNKED + b"2\r\n{}\r\n0\r\n", b"X"),
        "10^15 bytes promised": once(OK + b"Content-Length: 1000000000000000\r\n\r\n{}"),
        "negative length": once(OK + b"Content-Length: -5\r\n\r\n{}"),
        "length that is no number": once(OK + b"Content-Length: many\r\n\r\n{}"),
        "two lengths": once(OK + b"Content-Length: 2\r\nContent-Length: 99999\r\n\r\n{}"),
        "more than promised": once(OK + b"Content-Length: 2\r\n\r\n" + big),
        "the body drips": drip(OK + b"Content-Length: 5000\r\n\r\n", b"{"),
        "the body stops": silent(OK + b"Content-Length: 5000\r\n\r\n{"),
        "the body is cut": once(OK + b"Content-Length: 5000\r\n\r\n{"),
        "an endless body without a length": endless(OK + b"Connection: close\r\n\r\n", big),
        "closes at once": once(b""),
        "not HTTP": once(b"220 smtp.example ESMTP\r\n"),
        "HTTP 0.9": once(b"<html>hello</html>"),
        "binary": once(bytes(range(256)) * 100),
        "an impossible status": once(b"HTTP/1.1 99999 What\r\nContent-Length: 0\r\n\r\n"),
        "a reason with control characters": once(b"HTTP/1.1 404 \x1b[2J\x1b[31m\x07\r\nContent-Length: 0\r\n\r\n"),
        "redirects to itself": redirect(b"/manifest.json"),
        "redirects without end": counting(),
        "redirects to a file": redirect(b"file:///etc/passwd"),
        "redirects to another scheme": redirect(b"gopher://127.0.0.1:1/"),
        "redirects to nowhere": once(b"HTTP/1.1 302 Found\r\nContent-Length: 0\r\n\r\n"),
        "redirects to an address of 60 kB": redirect(b"/" + b"a" * 60000),
        "redirects with control characters": redirect(b"/\x1b[31m\x00"),
        "a gzip bomb": once(body(gzip.compress(bytes(100_000_000)), b"Content-Encoding: gzip\r\n")),
        "damaged gzip": once(body(b"\x1f\x8b rubbish", b"Content-Encoding: gzip\r\n")),
        "an unknown encoding": once(body(b"{}", b"Content-Encoding: rot13\r\n")),
        "a manifest of brackets": once(body(b"[" * 1_000_000)),
        "a manifest of 70 MB": once(body(b" " * 70_000_000 + b"{}")),
        "a web page": once(body(b"<!doctype html><p>Log in", b"Content-Type: text/html\r\n")),
        "not modified": once(b"HTTP/1.1 304 Not Modified\r\n\r\n"),
        "a range that nobody asked for": once(
            b"HTTP/1.1 206 Partial Content\r\nContent-Range: bytes 5-6/100\r\nContent-Length: 2\r\n\r\n{}"
        ),
        "come back in a thousand years": once(
            b"HTTP/1.1 503 Busy\r\nRetry-After: 99999999999\r\nContent-Length: 0\r\n\r\n"
        ),
        "come back never": once(b"HTTP/1.1 429 Slow\r\nRetry-After: NaN\r\nContent-Length: 0\r\n\r\n"),
        "a password wanted": once(
            b"HTTP/1.1 401 Who\r\nWWW-Authenticate: " + b"Basic " * 999 + b"\r\nContent-Length: 0\r\n\r\n"
        ),
        "cookies of 60 kB": once(body(b"{}", b"Set-Cookie: " + b"a" * 60000 + b"\r\n")),
    }
    for name in ("the body drips", "an endless body without a length", "a gzip bomb", "not modified", "a web page"):
        found[f"in a file: {name}"] = on_files(stream, found[name])
    return found


@contextmanager
def serving(behavior: Behavior) -> Iterator[int]:
    """A server with this behavior; its port."""
    listener = socket.create_server(("127.0.0.1", 0))
    open_sockets: list[socket.socket] = []

    def answer(connection: socket.socket) -> None:
        request = b""
        with suppress(OSError):
            while b"\r\n\r\n" not in request:
                more = connection.recv(65536)
                if not more:
                    return
                request += more
            behavior(connection.sendall, request.split(b" ", 2)[1].decode("latin-1"))
        with suppress(OSError):
            connection.shutdown(socket.SHUT_WR)

    def accept() -> None:
        with suppress(OSError):
            while True:
                connection, _ = listener.accept()
                connection.settimeout(LIMIT)
                open_sockets.append(connection)
                threading.Thread(target=answer, args=(connection,), daemon=True).start()

    threading.Thread(target=accept, daemon=True).start()
    try:
        yield listener.getsockname()[1]
    finally:
        listener.close()
        for connection in open_sockets:
            with suppress(OSError):
                connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
                connection.close()


def read(port: int, deadlines: Mapping[str, float]) -> str:
    """What comes of opening a stream and reading a frame: "read", or the code of the refusal.

    Args:
        port: of the server.
        deadlines: `stall`, `patience` and `first_patience` of `HttpSource`; its own where they are missing.

    Raises:
        ValueError: the sentence is not bounded, or has control characters.
    """
    try:
        with StreamReader.open(HttpSource(f"http://127.0.0.1:{port}/", **deadlines), threads=1) as reader:
            reader.gaussians(0)
        return "read"
    except StudioError as error:
        text = str(error)
        if len(text) > 3000 or any(ord(letter) < 32 and letter != "\n" for letter in text):
            raise ValueError(
                f"a sentence of {len(text)} characters, or with control characters: {text[:200]!r}"
            ) from None
        return error.code


def attack(folder: Path, share: float, outcome: Outcome) -> None:
    """All behaviors at once; with a small share, a part of them, with shorter deadlines."""
    deadlines = {"stall": 0.4, "patience": 0.8, "first_patience": 0.8} if share < 1 else {}
    stream = bake_numbered(folder / "honest", (2,), 25, 40, BakeSettings(preset="ultrafast"))
    slowest: list[tuple[float, str]] = []

    def attempt(name: str, behavior: Behavior) -> None:
        began = time.monotonic()
        try:
            with serving(behavior) as port:
                result = read(port, deadlines)
            if result == "read":
                outcome.failed(f"{name}: was read")
        except BaseException:
            outcome.failed(f"{name}: {traceback.format_exc(limit=-4)}")
        slowest.append((time.monotonic() - began, name))

    every = dict(list(behaviors(stream).items())[:: max(1, min(7, round(1 / share)))])
    threads = [threading.Thread(target=attempt, args=item, daemon=True) for item in every.items()]
    for thread in threads:
        thread.start()
    deadline = time.monotonic() + LIMIT
    for thread, name in zip(threads, every, strict=True):
        thread.join(max(0.0, deadline - time.monotonic()))
        outcome.count += 1
        if thread.is_alive():
            outcome.failed(f"{name}: not given up after {LIMIT:g} s")
    outcome.note(f"the slowest took {max(slowest)[0]:.1f} s ({max(slowest)[1]})")
