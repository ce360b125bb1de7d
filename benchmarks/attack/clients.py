"""Slow clients of `v3studio serve`, at the usual limit of 1,024 open files."""

from __future__ import annotations

import http.client
import random
import resource
import select
import socket
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path
from urllib.parse import urlsplit

from outcome import Outcome

from studio.stream import BakeSettings
from tests.support.streams import bake_numbered
from tests.support.tiny_capture import ROOT

FILES = 1024
CLIENTS = 1000
PATIENCE = 90.0
"""Seconds in which an honest client must be answered, and slow ones dropped: the server's longest limit is 30 s."""

MEMORY = 400 << 20
LOG = 1 << 20

_SERVE = f"""
import resource, sys, time
resource.setrlimit(resource.RLIMIT_NOFILE, ({FILES}, {FILES}))
from pipelines.share.serving import serve
with serve(sys.argv[1]) as serving:
    print(serving.address, flush=True)
    sys.stdin.read()
"""


def slow_client(place: tuple[str, int], number: int, path: str) -> socket.socket:
    """A connection that wants something, but slowly. Kind `number` of six."""
    connection = socket.create_connection(place, timeout=PATIENCE)
    head = f"GET {path}manifest.json HTTP/1.1\r\nHost: {place[0]}:{place[1]}\r\n".encode()
    begun = (
        b"",
        b"G",
        head,
        head + b"X: " + b"y" * 500,
        f"POST {path} HTTP/1.1\r\nHost: {place[0]}:{place[1]}\r\nContent-Length: 100000\r\n\r\n".encode() + b"x" * 50,
        (head + b"\r\n") * 20,  # answers that nobody reads
    )[number % 6]
    with suppress(OSError):
        connection.sendall(begun)
    connection.setblocking(False)
    return connection


def status_of(place: tuple[str, int], path: str) -> int | None:
    """Status of an honest request; None if there is no answer."""
    connection = http.client.HTTPConnection(*place, timeout=30)
    try:
        connection.request("GET", f"{path}manifest.json")
        answer = connection.getresponse()
        answer.read()
        return answer.status
    except (OSError, http.client.HTTPException):
        return None
    finally:
        connection.close()


def dropped(clients: list[socket.socket]) -> int:
    """How many connections the server has closed; reads what it sent."""
    count = 0
    for client in clients:
        with suppress(BlockingIOError):
            try:
                while data := client.recv(1 << 16):
                    del data
                count += 1
            except ConnectionError:
                count += 1
    return count


def attack(folder: Path, share: float, outcome: Outcome) -> None:
    """Slow clients take all connections; honest ones are answered, at the latest when the slow ones are dropped."""
    count = max(10, round(CLIENTS * share))
    most = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
    resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))
    stream = bake_numbered(folder / "served", (2,), 25, 40, BakeSettings(preset="ultrafast"))
    with tempfile.TemporaryFile() as log:
        command = [sys.executable, "-c", _SERVE, str(stream)]
        server = subprocess.Popen(command, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=log)
        assert server.stdin is not None
        assert server.stdout is not None
        try:
            address = urlsplit(server.stdout.readline().decode().strip())
            place, path = (address.hostname or "", address.port or 0), address.path
            if status_of(place, path) != 200:
                outcome.failed("an honest client alone is not answered")
                return
            clients = []
            for number in range(count):
                with suppress(OSError):
                    clients.append(slow_client(place, number, path))
                outcome.count += 1
            _honest(place, path, outcome)
            _all_dropped(clients, outcome)
            if status_of(place, path) != 200:
                outcome.failed("an honest client is not answered in the end")
            about = Path(f"/proc/{server.pid}/status").read_text()
            peak = int(about.split("VmHWM:")[1].split()[0]) << 10
            size = log.seek(0, 2)
            outcome.note(f"{peak >> 20} MB of memory, {size:,} bytes of log")
            if peak > MEMORY:
                outcome.failed(f"the server took {peak >> 20} MB")
            if size > LOG:
                outcome.failed(f"the log has {size} bytes")
            for client in clients:
                client.close()
        finally:
            server.stdin.close()
            with suppress(subprocess.TimeoutExpired):
                server.wait(30)
            server.kill()
            server.wait()


def _honest(place: tuple[str, int], path: str, outcome: Outcome) -> None:
    """Until an honest client is served: all other answers say that the server is busy."""
    began = time.monotonic()
    random_ = random.Random(1)
    while (status := status_of(place, path)) != 200:
        if status not in (503, None):
            outcome.failed(f"an honest client got status {status}")
        if time.monotonic() - began > PATIENCE:
            outcome.failed(f"no honest client was answered for {PATIENCE:g} s")
            return
        time.sleep(random_.random())
    outcome.note(f"an honest client was served after {time.monotonic() - began:.1f} s")


def _all_dropped(clients: list[socket.socket], outcome: Outcome) -> None:
    """Slow clients are dropped."""
    began = time.monotonic()
    while time.monotonic() - began < PATIENCE:
        left = len(clients) - dropped(clients)
        if left == 0:
            return
        select.select([], [], [], 0.5)
    outcome.failed(f"{left} of {len(clients)} slow clients still have a connection after {PATIENCE:g} s")
