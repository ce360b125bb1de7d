"""A take that is baked again, and whose bakes and server are killed, while clients read it over HTTP."""

from __future__ import annotations

import hashlib
import json
import random
import shutil
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from outcome import Outcome
from takes import PATIENCE, Project

from studio.errors import StudioError
from studio.stream import StreamReader
from tests.support.tiny_capture import ROOT, environment
from tests.support.warm_python import WarmProcess, warm_python

QPS = (20, 38)
GIVEN_UP = 150.0
"""Seconds in which a read must end: a client gives a server up after at most 30 s, more than once."""


def attack(project: Project, share: float, outcome: Outcome) -> None:
    """Rounds in which the other of two streams is baked, and something is killed."""
    random_ = random.Random("served")
    take = project.folder / "served"
    shutil.rmtree(take, ignore_errors=True)
    shutil.copytree(project.finished, take)
    known = {}
    for qp in QPS:
        bake(project, take, qp, "count", 0)
        known[qp] = frames_of(take / "stream")
    writes = int((take.parent / "served.writes").read_text())
    port, read, refused = 0, 0, 0
    for number in range(max(3, round(12 * share))):  # at least one of each kind
        killed, qp = ("nothing", "the bake", "the server")[number % 3], QPS[number % 2]
        where = f"round {number}, {killed} is killed"
        with served(take, port) as (server, address):
            port = int(address.split(":")[2].split("/")[0])
            clients = [Client(address) for _ in range(2)]
            for client in clients:
                client.wait_for_a_read()
            if killed == "the server":
                threading.Timer(random_.uniform(0, 2), server.kill).start()
            fault = ("kill", random_.randint(writes // 2, writes)) if killed == "the bake" else ("count", 0)
            bake(project, take, qp, *fault)
            if killed != "the server" and server.poll() is not None:
                outcome.failed(f"{where}: the server ended with {server.returncode}")
            server.kill()  # while they read
            for client in clients:
                client.end(where, set(known.values()), outcome)
                read, refused = read + len(client.read), refused + len(client.refused)
        bake(project, take, qp, "count", 0)
        with served(take, port) as (_, address):
            outcome.count += 1
            if patiently_read(address) != known[qp]:
                outcome.failed(f"{where}: afterwards other frames are served")
    outcome.note(f"{read:,} reads gave all frames of one bake, {refused} ended with a sentence")


def bake(project: Project, take: Path, qp: int, kind: str, number: int) -> None:
    """Bake the take with a fault."""
    ended = project.run(kind, number, take, "run", take, "--bake.qp", qp, "--until", "bake")
    assert ended.returncode in ((0, -9) if kind == "kill" else (0,)), ended.stderr


@contextmanager
def served(take: Path, port: int) -> Iterator[tuple[WarmProcess, str]]:
    """`v3studio serve` and its address; killed at the end."""
    command = ("-m", "pipelines.cli", "serve", take, "--port", port, "--json")
    server = warm_python().popen(command, text=True, cwd=ROOT, env=environment())
    try:
        assert server.stdout is not None
        line = server.stdout.readline()
        assert line, server.communicate(PATIENCE)[1]
        yield server, json.loads(line)["streams"][0]["address"]
    finally:
        server.kill()
        server.communicate(PATIENCE)


def frames_of(place: Path | str) -> str:
    """SHA-256 of the numbers of all frames, the last one first, so that all groups are read."""
    found = hashlib.sha256()
    with StreamReader.open(place, threads=1) as reader:
        for frame in (reader.frame_count - 1, *range(reader.frame_count)):
            for _, values in reader.gaussians(frame).items():
                found.update(values.numpy().tobytes())
    return found.hexdigest()


def patiently_read(place: str) -> str:
    """`frames_of`, again while a busy machine is too slow for it; the last sentence if it never succeeds."""
    end, said = time.monotonic() + PATIENCE, ""
    while time.monotonic() < end:
        try:
            return frames_of(place)
        except StudioError as error:
            said = str(error)
    return said


class Client:
    """Reads a served stream again and again on a thread of its own.

    Attributes:
        read: `frames_of` of what was read.
        refused: sentences.
        wrong: what was raised instead of a sentence.
    """

    def __init__(self, address: str) -> None:
        self.read: list[str] = []
        self.refused: list[str] = []
        self.wrong: list[str] = []
        self._address, self._done = address, threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        while not self._done.is_set() and not self.wrong:
            try:
                self.read.append(frames_of(self._address))
            except StudioError as error:
                self.refused.append(str(error))
                self._done.wait(0.1)
            except Exception as error:
                self.wrong.append(repr(error))

    def wait_for_a_read(self) -> None:
        """Until the first read or failure."""
        end = time.monotonic() + PATIENCE
        while not (self.read or self.refused or self.wrong) and time.monotonic() < end:
            time.sleep(0.05)

    def end(self, where: str, known: set[str], outcome: Outcome) -> None:
        """Stop reading, and judge what was read."""
        self._done.set()
        self._thread.join(GIVEN_UP)
        outcome.count += len(self.read) + len(self.refused)
        if self._thread.is_alive():
            outcome.failed(f"{where}: a client still reads after {GIVEN_UP:g} s")
        for wrong in self.wrong:
            outcome.failed(f"{where}: {wrong}")
        if not set(self.read) <= known:
            outcome.failed(f"{where}: a client read a mixture of bakes")
