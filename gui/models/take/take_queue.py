"""TakeQueue: the queue of takes as the window shows and changes it."""

import signal
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from v3studio.gui.drawing.palette import State
from v3studio.gui.models.loop import LOOP, Signal
from v3studio.gui.models.worker import Done, LatestWorker
from v3studio.pipelines.batch.queue_file import QueueFile, default_queue
from v3studio.pipelines.batch.run_queue import errors_of, start_queue
from v3studio.pipelines.config import load_config
from v3studio.pipelines.runs.status import progress
from v3studio.pipelines.takes.take import Take
from v3studio.studio.errors import StudioError

LOOK_EVERY = 1.0  # seconds between two looks at the queue and at the log of the take that runs


@dataclass(frozen=True)
class QueueRow:
    """A take in the list: its number, folder and state, and its progress or why it failed. `stage` runs, "" if nothing
    does; `fraction` of it is done, 0 to 1; None if it is not known yet, or nothing runs."""

    number: int
    take: Path
    state: State
    words: str
    stage: str = ""
    fraction: float | None = None

    def __str__(self) -> str:
        """The line in the list."""
        words = " ".join(self.words.split())
        shown = f"{self.number}   {self.take.name}   {self.state}{f': {words}' if words else ''}"
        return f"{shown}   ({self.take.parent})"


@dataclass(frozen=True)
class QueueView:
    """The queue at one moment. `is_run`: a program works through it. `error`: why it cannot be read; "" if it can."""

    rows: tuple[QueueRow, ...] = ()
    is_run: bool = False
    error: str = ""


def look(queue: QueueFile) -> QueueView:
    """Read the queue and the progress of the take that runs."""
    try:
        content = queue.read()
    except StudioError as error:
        return QueueView(error=str(error))
    is_run = queue.is_run()
    rows = []
    for entry in content.takes:
        state, words, stage, fraction = State(entry.state), entry.message, "", None
        if state == State.RUNNING:
            words, stage, fraction = progress(Take(entry.take)) if is_run else ("interrupted", "", None)
        rows.append(QueueRow(entry.number, entry.take, state, words, stage, fraction))
    return QueueView(tuple(rows), is_run)


class TakeQueue:
    """The user's queue of takes. Nothing here blocks. `message`: why the last change was refused, or why the program
    that ran the queue failed; "" if neither. While it is `watched`, on screen, its file is read now and then.

    Signals:
        changed: `state` has changed.
    """

    def __init__(self, queue: QueueFile | None = None) -> None:
        self._queue = queue or QueueFile(default_queue())
        self._worker: LatestWorker[QueueFile, QueueView] = LatestWorker(look, "v3studio queue", self._read)
        self._timer = LOOP.every(LOOK_EVERY, self._look)
        self.watched: Callable[[], bool] = lambda: True
        self.changed: Signal[[]] = Signal()
        self._process: subprocess.Popen[bytes] | None = None
        self.view = QueueView()
        self.message = ""

    def _look(self) -> None:
        """Read the queue on a thread, and note whether the program that works through it has ended."""
        if not self.watched():
            return
        self._worker.ask(self._queue)
        if self._process is not None and self._process.poll() is not None:
            code = self._process.returncode
            if code > 0:
                self.message = self._why_it_ended() or self.message
            elif code < 0 and code != -signal.SIGTERM:  # SIGTERM is how it is stopped
                name = signal.Signals(-code).name if -code in set(signal.Signals) else f"signal {-code}"
                memory = ", as by the system when memory runs out" if -code == signal.SIGKILL else ""
                ended = f"The program that worked through the queue was ended by {name}{memory}."
                self.message = f"{ended} Start it again to continue."
            self._process = None
            self._timer.soon()
            self.changed.emit()

    def _read(self, done: Done[QueueFile, QueueView]) -> None:
        view = done.result if done.result is not None else QueueView(error=str(done.error))
        if view != self.view:
            self.view = view
            self.changed.emit()

    def _why_it_ended(self) -> str:
        """The error of the program; "" if it only reports that takes failed, which the list shows."""
        try:
            lines = errors_of(self._queue).read_text(encoding="utf-8", errors="replace").splitlines()
        except OSError as error:
            return str(error)
        return next((line.removeprefix("error: ") for line in reversed(lines) if line.startswith("error: ")), "")

    @property
    def state(self) -> tuple[QueueView, str, bool]:
        """Everything that is shown of it; compared for equality."""
        return self.view, self.message, self.running

    @property
    def running(self) -> bool:
        """Whether a program works through the queue, or has just been started to do so."""
        return self.view.is_run or self._process is not None

    @property
    def words(self) -> str:
        """The queue in a sentence."""
        if self.view.error:
            return self.view.error
        if not self.view.rows:
            return "The queue is empty."
        states = [row.state for row in self.view.rows]
        counts = ", ".join(f"{states.count(state)} {state}" for state in (State.WAITING, State.DONE, State.FAILED))
        return f"{'Running' if self.running else 'Not running'}: {counts}."

    def add(self, folder: Path) -> None:
        with self._changing():
            take = Take.open(folder)
            load_config(take.config)  # report invalid settings now, not overnight
            self._queue.add(take.root, None, ())

    def move(self, number: int, by: int) -> None:
        """Move a take up (-1) or down (1) among those that wait."""
        waiting = [row.number for row in self.view.rows if row.state == State.WAITING]
        place = waiting.index(number) + 1 + by if number in waiting else 1
        with self._changing():
            self._queue.move(number, place)

    def remove(self, number: int) -> None:
        """Remove a take from the list; its folder is not touched."""
        with self._changing():
            self._queue.remove(number)

    def retry(self, number: int) -> None:
        """Let a take that has ended wait again."""
        with self._changing():
            self._queue.retry(number)

    def start(self) -> None:
        """Work through the queue in a process that keeps running when the window is closed."""
        if not self.running:
            with self._changing():
                self._queue.path.parent.mkdir(parents=True, exist_ok=True)
                self._process = start_queue(self._queue)

    def stop(self) -> None:
        """Stop working through the queue; the take that runs keeps finished work and waits again."""
        with self._changing():
            if self._process is not None and not self._queue.is_run():  # it has not begun yet
                self._process.terminate()
            else:
                self._queue.stop()

    @contextmanager
    def _changing(self) -> Iterator[None]:
        self.message = ""
        try:
            yield
        except (StudioError, OSError) as error:
            self.message = str(error)
        self._timer.soon()
        self.changed.emit()
