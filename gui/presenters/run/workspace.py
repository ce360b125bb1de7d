"""Workspace: the take that is open, how its stages stand, and the run that works on it.

All of it is computed from the take on disk, so that what a terminal does shows up here as well.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from gui.presenters.run.jobs import Job, LogFollower, is_paused, pause_process, stop_process
from gui.presenters.run.run_state import RunState
from gui.presenters.stages.stage_rows import TITLES, Assessment, StageRow, assess, pipeline_name
from gui.presenters.worker import LatestWorker
from pipelines.config import Config, load_config
from pipelines.config.loading import COMMAND_LINE
from pipelines.stages.base import Context
from pipelines.takes.atomic_files import disk_errors
from pipelines.takes.settings_file import save_config
from pipelines.takes.take import Take
from studio.errors import StudioError

LOOK_EVERY = 0.5
"""Seconds between two looks at the take's folder."""

ASSESS_EVERY = 30.0
"""Seconds after which the stages are assessed again although nothing seems to have changed."""


class Workspace:
    """See the module. `poll` at each tick; nothing here waits.

    Args:
        start_job: makes a job of a take and arguments; tests give their own.
        now: a clock in seconds that never runs backwards.
    """

    def __init__(
        self, start_job: Callable[[Take, tuple[str, ...]], Job] = Job, now: Callable[[], float] = time.monotonic
    ) -> None:
        self._start_job, self._now = start_job, now
        self._worker: LatestWorker[Context, Assessment] = LatestWorker(assess, "v3studio assess")
        self._clear()

    def _clear(self) -> None:
        self.take: Take | None = None
        self.context: Context | None = None
        self.assessment = Assessment()
        self.assessed = False
        self.run = RunState()
        self.job: Job | None = None
        self.holder: dict[str, object] | None = None
        self.message = ""
        self.cancelling = False
        self.paused = False
        self._follower: LogFollower | None = None
        self._next_look = 0.0
        self._next_assess = 0.0
        self._fingerprint: tuple[object, ...] = ()
        self._results_seen = 0

    # What is open

    def open(self, take: Take | None) -> None:
        """Work on this take; None for a bare stream. A job of the take before goes on by itself."""
        self._clear()
        self.take = take
        if take is None:
            return
        self._follower = LogFollower(take.log)
        self._read_config()
        self.poll()

    @property
    def config(self) -> Config | None:
        """The take's settings; None where there are none."""
        return self.context.config if self.context else None

    def _read_config(self) -> None:
        assert self.take is not None
        try:
            self.context = Context(self.take, load_config(self.take.config))
        except StudioError as error:
            self.context, self.message = None, str(error)

    # Each tick

    def poll(self) -> bool:
        """Take in what has happened; returns whether something changed that is shown."""
        if self.take is None:
            return False
        before = self._shown()
        if self.job is not None:
            for event in self.job.poll():
                self.run.apply(event)
            if not self.job.running:
                crash = self.job.crash()
                if crash is not None:
                    self.run.crashed(*crash)
                self._job_over()
        if self._now() >= self._next_look:
            self._next_look = self._now() + LOOK_EVERY
            self._look()
        done = self._worker.take()
        if done is not None and self.context is not None and done.request.config is self.context.config:
            self.assessed = True
            if done.result is not None:
                self.assessment = done.result
            else:
                self.message = f"The take cannot be assessed: {done.error}"
        return before != self._shown()

    def _shown(self) -> tuple[object, ...]:
        return self.run.changes, self.assessment, self.holder, self.message, self.assessed, self.paused

    def _job_over(self) -> None:
        assert self.take is not None
        self.job, self.cancelling, self.paused = None, False, False
        self._follower = LogFollower(self.take.log)
        self._follower.poll()  # what the job told is known already
        self.holder = None
        self._next_look = self._next_assess = 0.0

    def _look(self) -> None:
        """Has anything changed on disk?"""
        assert self.take is not None
        assert self._follower is not None
        self.paused = self.pid is not None and is_paused(self.pid)
        if self.job is None:
            anew, events = self._follower.poll()
            if anew and events:
                self.run = self.run.followed()
            for event in events:
                self.run.apply(event)
            holder = self.take.running()
            if self.holder is not None and holder is None:
                self.cancelling = False
                self._next_assess = 0.0
            self.holder = holder
            if holder is None and self.run.changes and not self.run.outcome and self.run.lines:
                self.run.crashed("The last run ended without a word (it was killed, or crashed); run again to go on.")
        fingerprint = self._take_fingerprint()
        if fingerprint != self._fingerprint or self._now() >= self._next_assess:
            inputs_changed = self._fingerprint[:2] != fingerprint[:2]
            self._fingerprint = fingerprint
            self._next_assess = self._now() + ASSESS_EVERY
            if inputs_changed or self.context is None:
                self._read_config()
            if self.context is not None:  # a context of its own: the views' one keeps the footage as it was opened
                self._worker.ask(Context(self.take, self.context.config))

    def _take_fingerprint(self) -> tuple[object, ...]:
        """Changes with whatever makes a stage's state change, and costs little."""
        assert self.take is not None
        paths = [self.take.config, self.take.rig, self.take.private / "stages", self.take.stream, self.take.evaluation]
        return (*(_changed(path) for path in paths), self.run.outcome, len(self.run.finished))

    # The list of stages

    @property
    def busy(self) -> bool:
        """Whether a run works on the take, ours or another's."""
        return self.job is not None or self.holder is not None

    def rows(self) -> list[StageRow]:
        """The list of stages as it stands now."""
        return [self._row(key) for key in TITLES]

    def row(self, key: str) -> StageRow:
        """One of `rows`."""
        return self._row(key)

    def _row(self, key: str) -> StageRow:
        if self.take is None:
            return StageRow(key, "missing", "")
        if key == "capture":
            return self._capture_row()
        name = pipeline_name(key)
        if self.busy:
            if self.run.stage == name:
                words = "stopping" if self.cancelling else "paused" if self.paused else self.run.stage_words()
                return StageRow(key, "running", words, "", self.run.progress.fraction if self.run.progress else 0.0)
            if name in self.run.planned and name not in self.run.finished and name not in self.run.failed:
                return StageRow(key, "waiting", "waiting")
        if name in self.run.failed and not self.busy and not (self.assessed and self._state(name) == "done"):
            return StageRow(key, "failed", "failed", self.run.failed[name])
        status = self.assessment.stages.get(name)
        if status is None:
            return StageRow(key, "missing", "" if self.assessed else "looking")
        words = status.state
        if status.state == "partial":
            words = f"{status.units_done} of {status.units} {status.unit}"
        return StageRow(key, status.state, words, status.reason)

    def _state(self, name: str) -> str:
        status = self.assessment.stages.get(name)
        return status.state if status else "missing"

    def _capture_row(self) -> StageRow:
        if self.context is None:
            return StageRow("capture", "failed", "no settings", self.message)
        if self.assessment.footage_error:
            return StageRow("capture", "failed", "cannot be read", self.assessment.footage_error)
        if not self.assessed:
            return StageRow("capture", "missing", "looking")
        return StageRow("capture", "done", self.assessment.footage)

    # Running

    def start(self, key: str, again: bool = False) -> bool:
        """Run what is needed until this stage is done; `again` runs a stage that is done once more. "all" runs all.

        Returns False, with `message` saying why, where it cannot be started.
        """
        if self.take is None:
            self.message = "Open a take first; a bare stream has nothing to run."
            return False
        if self.busy:
            self.message = "A run works on this take already; cancel it or wait for it."
            return False
        if self.context is None:
            return False
        name = pipeline_name(key)
        arguments = ("run",) if key == "all" else (name, "--force") if again else ("run", "--until", name)
        self.message = ""
        self.run = self.run.followed()
        try:
            with disk_errors(self.take.root):
                self.job = self._start_job(self.take, arguments)
        except (StudioError, OSError) as error:
            self.message = f"The run could not be started: {error}"
            return False
        return True

    def cancel(self) -> None:
        """Ask the run to stop, whoever started it; what is finished is kept."""
        if self.job is not None:
            self.job.cancel()
            self.cancelling = True
        elif self.holder is not None:
            pid = self.pid
            if pid is not None and stop_process(pid):
                self.cancelling = True
            else:
                self.message = f"The run (process {pid}) could not be stopped from here; stop it where it was started."

    def pause(self) -> None:
        """Halt the run, whoever started it, or let it go on if it is halted. It keeps its memory; a machine that is
        switched off meanwhile costs what is not finished."""
        pid = self.pid
        if pid is None:
            return
        if pause_process(pid, not self.paused):
            self.paused = not self.paused  # the system takes a moment; `_look` sees what came of it
        else:
            self.message = f"The run (process {pid}) could not be paused from here; do it where it was started."

    @property
    def pid(self) -> int | None:
        """Process of the run that works on the take; None where none does."""
        if self.job is not None:
            return self.job.pid
        pid = self.holder.get("pid") if self.holder is not None else None
        return pid if isinstance(pid, int) else None

    def change_setting(self, name: str, value: Any) -> str:
        """Write a setting into the take's config.yaml; returns "" or what is wrong with it."""
        if self.take is None or self.context is None:
            return "There is no take whose settings could be changed."
        if self.busy:
            return "Settings can be changed when the run is over; cancel it first."
        try:
            config = load_config(self.take.config, [(name, value)])
            if config != self.context.config:
                with disk_errors(self.take.root):
                    save_config(self.take.config, config)  # keeps comments
        except StudioError as error:
            return str(error).removeprefix(f"{COMMAND_LINE}: ")
        self._next_look = 0.0
        return ""

    def take_results(self) -> bool:
        """True once after something new has come to stand in the take."""
        changed = self.run.results != self._results_seen
        self._results_seen = self.run.results
        return changed

    def close(self) -> bool:
        """End the thread; a job goes on by itself. Returns whether the thread ended in time."""
        return self._worker.close()


def _changed(path: Path) -> int:
    try:
        return path.stat().st_mtime_ns
    except OSError:
        return 0
