import contextlib
import errno
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.support.errors import refuses
from tests.support.tiny_capture import ROOT, v3studio
from v3studio.pipelines.batch.queue_file import QueuedTake, QueueFile
from v3studio.pipelines.batch.run_queue import run_queue
from v3studio.pipelines.events import Event, Finished, RunStarted
from v3studio.pipelines.runs.status import progress
from v3studio.pipelines.takes.take import Take
from v3studio.studio.errors import StudioError

pytestmark = pytest.mark.long

RUN_QUEUE = """
import signal, sys
from pathlib import Path
from v3studio.pipelines.batch.queue_file import QueueFile
from v3studio.pipelines.batch.run_queue import run_queue
signal.signal(signal.SIGTERM, signal.default_int_handler)
emit = lambda event: print("started", flush=True)
program = lambda entry: [sys.executable, "-c", sys.argv[2], entry.take.name]
run_queue(QueueFile(Path(sys.argv[1])), print, emit, print, program)
"""


@contextlib.contextmanager
def working(queue: QueueFile) -> Iterator[subprocess.Popen[str]]:
    """A process that works through a queue and has started its first take."""
    command = [sys.executable, "-c", RUN_QUEUE, str(queue.path), PROGRAM]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, cwd=ROOT, text=True) as process:
        assert any(line == "started\n" for line in process.stdout)
        yield process


@pytest.fixture
def queue(tmp_path: Path) -> QueueFile:
    return QueueFile(tmp_path / "state" / "queue.json")


def numbers(queue: QueueFile) -> list[int]:
    return [entry.number for entry in queue.read().takes]


def test_takes_are_kept_in_order_and_numbers_are_never_given_twice(queue: QueueFile, tmp_path: Path) -> None:
    assert queue.read().takes == ()
    for name in "abc":
        queue.add(tmp_path / name, None, ())
    queue.move(3, 1)
    assert numbers(queue) == [3, 1, 2]
    queue.move(3, 99)
    assert numbers(queue) == [1, 2, 3]
    queue.remove(3)
    assert queue.add(tmp_path / "d", tmp_path / "d.yaml", ("bake.quality=30",)).number == 4
    assert numbers(QueueFile(queue.path)) == [1, 2, 4]
    entry = queue.read().takes[-1]
    assert (entry.config, entry.overrides, entry.state) == (tmp_path / "d.yaml", ("bake.quality=30",), "waiting")


def test_what_cannot_be_is_refused(queue: QueueFile, tmp_path: Path) -> None:
    queue.add(tmp_path / "a", None, ())
    with refuses("queue.duplicate", file=tmp_path / "a", value=1):
        queue.add(tmp_path / "a", None, ())
    with refuses("queue.unknown", value=7):
        queue.remove(7)
    with refuses("queue.not_ended", value=1):
        queue.retry(1)
    queue.replace(1, state="failed", message="no footage")
    with refuses("queue.not_waiting", value=1):
        queue.move(1, 1)
    queue.add(tmp_path / "a", None, ())  # it may be tried again
    queue.retry(1)
    assert [entry.state for entry in queue.read().takes] == ["waiting", "waiting"]
    queue.path.write_text('{"takes": [{"number": 0}]}')
    with refuses("take.damaged", file=queue.path):
        queue.read()
    with pytest.raises(StudioError):
        queue.add(tmp_path / "b", None, ())
    assert queue.path.read_text() == '{"takes": [{"number": 0}]}'


def test_only_one_program_works_through_it(queue: QueueFile, tmp_path: Path) -> None:
    queue.add(tmp_path / "a", None, ())
    queue.replace(1, state="running")
    assert not queue.is_run()
    with queue.running():
        assert queue.read().takes[0].state == "waiting", "the one that left it so has ended"
        queue.replace(1, state="running")
        assert queue.is_run()
        with refuses("queue.already_run", file=queue.path), QueueFile(queue.path).running():
            pass
        with refuses("queue.running", value=1):
            queue.remove(1)
    assert not queue.is_run()


def test_it_is_stopped_from_elsewhere(queue: QueueFile, tmp_path: Path) -> None:
    with refuses("queue.not_run", file=queue.path):
        queue.stop()
    queue.add(tmp_path / "slow", None, ())
    with working(queue) as process:
        assert queue.stop() == process.pid
        process.communicate()
    assert queue.read().takes[0].state == "waiting"
    with queue.running():  # as left by a program on another machine that shares the folder
        lock = queue.path.with_name(f".{queue.path.name}.run")
        lock.write_text('{"pid": 1, "host": "elsewhere.example"}')
        with refuses("queue.cannot_stop", file=queue.path):
            queue.stop()
    with queue.running():
        assert str(os.getpid()) in lock.read_text()
    assert lock.read_text() == "", "the next program is never taken for this one"


@pytest.mark.skipif("V3STUDIO_WITHOUT_LOCKS" in os.environ, reason="only a lock tells that something runs")
def test_what_has_just_begun_is_not_stopped(queue: QueueFile) -> None:
    with queue.running():
        queue.path.with_name(f".{queue.path.name}.run").write_text("")
        with refuses("queue.unknown_runner", file=queue.path):
            queue.stop()


def test_changes_at_the_same_time_are_all_kept(queue: QueueFile, tmp_path: Path) -> None:
    def add(first: int) -> None:
        for number in range(10):
            QueueFile(queue.path).add(tmp_path / f"{first}-{number}", None, ())

    threads = [threading.Thread(target=add, args=(first,)) for first in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert numbers(queue) == list(range(1, 41))
    assert len({entry.take for entry in queue.read().takes}) == 40


PROGRAM = """
import json, sys, time
name = sys.argv[1]
print("a line of a library")
print(json.dumps({"event": "log", "time": 0, "stage": "train", "message": f"{name} starts"}), flush=True)
if name == "slow":
    time.sleep(600)
sys.exit({"good": 0, "bad": 1, "crash": -6}.get(name, 0))
"""


def program(entry: QueuedTake) -> list[str]:
    code = "import os; os.abort()" if entry.take.name == "crash" else PROGRAM
    return [sys.executable, "-c", code, entry.take.name]


def test_a_failed_take_does_not_stop_the_next_one(queue: QueueFile, tmp_path: Path) -> None:
    for name in ("bad", "good", "crash", "last"):
        queue.add(tmp_path / name, None, ())
    said: list[Event] = []

    def ended(entry: QueuedTake) -> None:
        if entry.take.name == "bad":
            queue.add(tmp_path / "later", None, ())  # while it runs

    assert run_queue(queue, lambda entry: None, said.append, ended, program) == (3, 2)
    ended_as = {entry.take.name: (entry.state, entry.message) for entry in queue.read().takes}
    assert ended_as == {
        "bad": ("failed", "a line of a library"),
        "good": ("done", ""),
        "crash": ("failed", "the process was ended by SIGABRT"),
        "last": ("done", ""),
        "later": ("done", ""),
    }
    assert [event.message for event in said] == ["bad starts", "good starts", "last starts", "later starts"]


def test_a_take_that_cannot_be_read_is_skipped(
    queue: QueueFile, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("gone", "good", "unreachable"):
        queue.add(tmp_path / name, None, ())
    queue.replace(3, folder=tmp_path / "nowhere")
    running = Take.running

    def stale(take: Take) -> object:
        if take.root.name == "gone":
            raise OSError(errno.ESTALE, os.strerror(errno.ESTALE), str(take.root))
        return running(take)

    monkeypatch.setattr(Take, "running", stale)
    assert progress(Take(tmp_path / "gone"))[1:] == ("", None), "it is listed, too"
    assert run_queue(queue, lambda _: None, lambda _: None, lambda _: None, program) == (1, 2)
    assert [entry.state for entry in queue.read().takes] == ["failed", "done", "failed"]
    assert str(tmp_path / "gone") in queue.read().takes[0].message


@pytest.mark.parametrize(("number", "state"), [(signal.SIGINT, "waiting"), (signal.SIGKILL, "running")])
def test_stopped_or_killed_it_goes_on(queue: QueueFile, tmp_path: Path, number: signal.Signals, state: str) -> None:
    queue.add(tmp_path / "slow", None, ())
    queue.add(tmp_path / "good", None, ())
    with working(queue) as process:
        (child,) = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
        process.send_signal(number)
        assert process.wait() != 0
        with contextlib.suppress(ProcessLookupError):  # kill -9 of the queue leaves the run, which goes on by itself
            os.kill(int(child), signal.SIGKILL)
    assert queue.read().takes[0].state == state
    nothing = lambda _: None  # noqa: E731
    assert run_queue(queue, nothing, nothing, nothing, lambda _: [sys.executable, "-c", ""]) == (2, 0)


def test_a_take_that_another_program_runs_is_waited_for(queue: QueueFile, tmp_path: Path) -> None:
    take = Take.create(tmp_path / "take")
    queue.add(take.root, None, ())
    order: list[str] = []
    with take.locked("v3studio run"):
        tell = (lambda _: order.append("starts"), lambda _: None, lambda _: order.append("ended"))
        worker = threading.Thread(target=run_queue, args=(queue, *tell, lambda _: [sys.executable, "-c", ""]))
        worker.start()
        while not order:
            time.sleep(0.02)
        time.sleep(0.3)
        order.append("unlocked")
    worker.join()
    assert order == ["starts", "unlocked", "ended"]


def test_the_commands(copied: Path, tmp_path: Path, here: Callable[..., Any]) -> None:
    option = ("--queue", tmp_path / "queue.json")
    settings, take = copied / "ball.yaml", copied / "take"
    broken = settings.with_name("broken.yaml")
    broken.write_text(settings.read_text().replace("root: capture", "root: nothing"))

    def add(*arguments: object) -> Any:
        return here("queue", "add", *arguments, *option)

    add(broken, "--take", tmp_path / "one").ok()
    add(take).ok()
    add(settings, "--take", tmp_path / "three", "--train.group_size", "-1").fails("group_size", code=2)
    add(settings).fails("--take takes/first", code=2)
    assert "queue run` starts it" in here("queue", "list", *option).stdout
    done = v3studio("queue", "run", "--json", *option)
    assert done.fails().result == {"done": 1, "failed": 1}
    assert sum(isinstance(event, Finished) for event in done.events) == 1, "not those of the takes"
    assert any(isinstance(event, RunStarted) for event in done.events)
    takes = here("queue", "list", "--json", *option).result["takes"]
    assert [entry["state"] for entry in takes] == ["failed", "done"]
    assert "nothing" in takes[0]["message"]
