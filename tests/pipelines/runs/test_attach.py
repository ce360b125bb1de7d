"""Attaching to a run: only its own events are shown, not those that an earlier run left in the log."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator

import pytest

from pipelines.events import Event, Log, RunFinished, RunStarted
from pipelines.runs import attach as module
from pipelines.runs.attach import attach
from pipelines.takes.atomic_files import write_text
from pipelines.takes.take import Take
from studio.errors import StudioError


def lines(*events: Event) -> str:
    return "".join(event.to_json() + "\n" for event in events)


def started(pid: int) -> RunStarted:
    return RunStarted(take="t", stages=("train",), done=(), pid=pid, version="1")


FAILED = RunFinished(outcome="failed", seconds=1.0, message="an old error", code="old.error")
DONE = RunFinished(outcome="done", seconds=1.0)
OLD = {
    "finished": lines(started(1), Log(message="old"), DONE),
    "failed before it began": lines(Log(message="old"), FAILED),
    "killed": lines(started(1), Log(message="old")),
    "of the same process": lines(started(os.getpid()), Log(message="old"), FAILED),
}


class Attached:
    """`attach` in a thread."""

    def __init__(self, take: Take) -> None:
        self.shown: list[Event] = []
        self.error: StudioError | None = None
        self.looked = threading.Event()
        self._take = take
        self.thread = threading.Thread(target=self._run)
        self.thread.start()

    def _run(self) -> None:
        try:
            attach(self._take, self.shown.append)
        except StudioError as error:
            self.error = error


@pytest.fixture
def looks(monkeypatch: pytest.MonkeyPatch) -> Iterator[threading.Semaphore]:
    """Is released at every look of `attach`."""
    found = threading.Semaphore(0)
    wait = threading.Event().wait

    class Time:
        monotonic = staticmethod(module.time.monotonic)

        @staticmethod
        def sleep(_: float) -> None:
            found.release()
            wait(0.01)

    monkeypatch.setattr(module, "time", Time)
    monkeypatch.setattr(module, "_GONE_SECONDS", 60.0)
    return found


@pytest.fixture
def take(tmp_path) -> Take:
    return Take.create(tmp_path / "take")


@pytest.mark.parametrize("old", OLD.values(), ids=OLD)
def test_an_earlier_run_is_not_shown(take, looks, old):
    take.private.mkdir()
    take.log.write_text(old)
    own = (started(os.getpid()), Log(message="new"))
    with take.locked("v3studio run"):
        attached = Attached(take)
        assert looks.acquire(timeout=60)  # it has seen the old log
        write_text(take.log, lines(*own))
        while not attached.shown and attached.thread.is_alive():
            looks.acquire(timeout=60)
    with take.log.open("a") as log:
        log.write(lines(DONE))
    attached.thread.join()
    assert attached.error is None
    assert [event.kind for event in attached.shown] == ["run_started", "log", "run_finished"]
    assert attached.shown[1].message == "new"


def test_a_run_that_fails_before_it_begins_says_why(take, looks):
    take.private.mkdir()
    take.log.write_text(OLD["finished"])
    with take.locked("v3studio run"):
        attached = Attached(take)
        assert looks.acquire(timeout=60)
        write_text(take.log, lines(Log(message="migrated")))
    with take.log.open("a") as log:
        log.write(lines(FAILED))
    attached.thread.join()
    assert attached.error is not None
    assert attached.error.code == "old.error"
    assert [event.kind for event in attached.shown] == ["log", "run_finished"]


def test_a_command_without_a_log_ends_without_the_outcome_of_another(take, looks, monkeypatch):
    monkeypatch.setattr(module, "_GONE_SECONDS", 0.1)
    take.private.mkdir()
    take.log.write_text(OLD["finished"])
    with take.locked("v3studio check"):
        attached = Attached(take)
        assert looks.acquire(timeout=60)
    attached.thread.join()
    assert attached.shown == []
    assert attached.error is not None
    assert "v3studio check ended before it reported anything" in str(attached.error)
