"""Workspace: the open take, the status of its stages, and the run that works on it.

The state is read from the take on disk, so that runs started in a terminal show up too.
"""

import socket
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from v3studio.gui.drawing.palette import State
from v3studio.gui.models.history import Change, History
from v3studio.gui.models.loop import LOOP, Signal
from v3studio.gui.models.stage_rows import TITLES, Assessment, StageRow, assess, pipeline_name
from v3studio.gui.models.stages import Inputs
from v3studio.gui.models.take.doubts import doubts, worst_first
from v3studio.gui.models.take.jobs import Job, pause_process, stop_process
from v3studio.gui.models.take.page_words import setting_words, value_words, why_not_done
from v3studio.gui.models.take.remedies import REMEDIES
from v3studio.gui.models.take.run_state import Outcome, RunState
from v3studio.gui.models.take.settings import setting_value
from v3studio.gui.models.worker import Done, LatestWorker
from v3studio.pipelines.config import Config, load_config
from v3studio.pipelines.events import Finished, Warned
from v3studio.pipelines.events.event_log import LogFollower
from v3studio.pipelines.reports.terminal import duration
from v3studio.pipelines.runs.status import is_paused
from v3studio.pipelines.takes.cancel_request import request_cancel
from v3studio.pipelines.takes.files.disk_errors import disk_errors
from v3studio.pipelines.takes.files.settings_file import save_config
from v3studio.pipelines.takes.take import Take
from v3studio.studio.counts import counted
from v3studio.studio.errors import StudioError
from v3studio.studio.settings import OVERRIDES

LOOK_EVERY = 0.5  # seconds between two scans of the take's folder
ASSESS_EVERY = 30.0  # seconds after which the stages are reassessed even without a visible change

NOT_JUDGED = "Nothing has judged the masks yet: look at them, and press Check."

KILLED = "The run was killed or crashed. Run again to continue."

FOOTAGE_CACHE = 512 * 1024 * 1024
"""Bytes of decoded images that are kept of the footage without cameras, and again of that with them, as of decoded
frames. A run may keep far more, but a window is open for hours, and its user has other programs."""


class Workspace:
    """The open take: its settings, the status of its stages, and its run. Nothing here blocks.

    Attributes:
        history: changes of the take's settings and marks, for undo.
        assessed: whether `assessment` is of this take, maybe before the last change.
        checked: whether it is of the take as it is now, as far as is known.

    Signals:
        changed: anything that is shown of the take or its run has changed.
        new_results: the take has new results.
        run_ended: a run has ended well or was killed: what to know first, and whether that is bad.
        refused: a run cannot be started, paused or cancelled, for this reason.
    """

    def __init__(self) -> None:
        self._worker: LatestWorker[Inputs, Assessment] = LatestWorker(assess, "v3studio assess", self._assessed)
        self._timer = LOOP.every(LOOK_EVERY, self._look)
        self.changed: Signal[[]] = Signal()
        self.new_results: Signal[[]] = Signal()
        self.run_ended: Signal[[str, bool]] = Signal()
        self.refused: Signal[[str]] = Signal()
        self._seen: object = None
        self.opening = ""
        self._clear()

    def _clear(self) -> None:
        self.history = History()
        self.take: Take | None = None
        self.context: Inputs | None = None
        self.assessment = Assessment()
        self.assessed = self.checked = False
        self._asked: Inputs | None = None  # for the assessment of the take as it is now
        self.run = RunState()
        self.job: Job | None = None
        self.holder: dict[str, object] | None = None
        self._unread = self._unassessed = ""  # why the settings, and the status, cannot be read
        self.cancelling = False
        self.paused = False
        self.masks_judged: object = None  # settings of the footage whose masks agree in all frames
        self._follower: LogFollower | None = None
        self._next_assess = 0.0
        self._fingerprint: tuple[object, ...] = ()
        self._results_seen = 0

    # The open take

    def open(self, take: Take | None) -> None:
        """Open this take; None for a bare stream. A job of the previous take keeps running."""
        self._clear()
        self.take = take
        if take is None:
            return
        self._follower = LogFollower(take.log)
        self._read_config()
        self._look()

    @property
    def config(self) -> Config | None:
        """The take's settings; None if they cannot be read."""
        return self.context.config if self.context else None

    @property
    def problem(self) -> str:
        """Return why the settings or the status of the stages cannot be read; "" if they can."""
        return self._unread or self._unassessed

    @property
    def without_settings(self) -> str:
        """Return why there are no settings: nothing, or a bare stream, is open; "" if they cannot be read, see
        `problem`."""
        if self.take is not None:
            return ""
        if self.opening:
            return f"Opening {self.opening} ..."
        return "No take is open. A stream has no footage."

    def _new_context(self, config: Config) -> Inputs:
        assert self.take is not None
        return Inputs(self.take, config, most_cached=FOOTAGE_CACHE)

    def _read_config(self) -> None:
        assert self.take is not None
        try:
            self.context, self._unread = self._new_context(load_config(self.take.config)), ""
        except StudioError as error:
            self.context, self._unread = None, str(error)
            if not self.take.root.is_dir():
                self.assessment = Assessment()
                self._unread = f"{self.take.root}: the folder of this take is gone. It was moved or deleted."
        self._unchecked()

    def _unchecked(self) -> None:
        """Something has changed: an assessment that has begun before does not count."""
        self.checked, self._asked = False, None

    # Changes by the run and on disk

    def _job_output(self) -> None:
        """Apply the events of the job."""
        job = self.job
        if job is None:
            return
        ended = ""
        for event in job.take_events():
            self.run.apply(event)
            if isinstance(event, Finished) and event.outcome == Outcome.DONE:
                took = f"The run has finished after {duration(event.seconds)}."
                ended = took if self.run.planned else "There was nothing to run: everything is up to date."
                told = doubts([warning for warnings in self.run.warnings.values() for warning in warnings])
                if told:
                    more = f" {counted(len(told) - 1, 'other kind')} of warnings: see the log." if told[1:] else ""
                    ended = f"{told[0]}{more}\n{ended}"
        if job.status is not None:
            crash = job.crash()
            if crash is not None:
                self.run.crashed(*crash)
                self.run_ended.emit(crash[0], True)
            assert self.take is not None
            self.job, self.cancelling, self.paused = None, False, False
            self._follower = LogFollower(self.take.log)
            self._follower.poll()  # the job's events are already known
            self.holder = None
            self._look_soon()
        self._notify()
        if ended:
            self.run_ended.emit(ended, bool(self.run.warnings))

    def _assessed(self, done: Done[Inputs, Assessment]) -> None:
        if self.context is None or done.request.config is not self.context.config:
            return
        self.assessed = True
        self._unassessed = "" if done.result is not None else f"Cannot read the status of the take: {done.error}"
        self.checked = done.result is not None and (self.checked or done.request is self._asked)
        if done.result is not None:
            self.assessment = done.result
        self._notify()

    def _notify(self) -> None:
        """Emit what has changed since the last time."""
        now = (self.run.changes, self.assessment, self.holder, self.problem, self.assessed, self.checked, self.paused)
        shown = (*now, self.context)
        if shown != self._seen:
            self._seen = shown
            self.changed.emit()
        if self.run.results != self._results_seen:
            self._results_seen = self.run.results
            self.new_results.emit()

    def _look_soon(self) -> None:
        self._next_assess = 0.0
        self._timer.soon()

    def _look(self) -> None:
        """Look for changes on disk."""
        if self.take is None or self._follower is None:
            return
        if self.job is None:
            is_new, events = self._follower.poll()
            if is_new:  # maybe empty as yet
                self.run = self.run.followed()
            for event in events:
                self.run.apply(event)
            holder = self.take.running()
            if self.holder is not None and holder is None:
                self.cancelling = False
                self._next_assess = 0.0
            self.holder = holder
            if holder is None and self.run.changes and not self.run.outcome and self.run.begun:
                self.run.crashed(KILLED)
                self.run_ended.emit(KILLED, True)
        self.paused = self.pid is not None and not self._elsewhere and is_paused(self.pid)
        fingerprint = self._take_fingerprint()
        now = time.monotonic()
        if fingerprint != self._fingerprint or now >= self._next_assess:
            inputs_changed = self._fingerprint[:3] != fingerprint[:3]
            if fingerprint != self._fingerprint:
                self._unchecked()
            self._fingerprint = fingerprint
            self._next_assess = now + ASSESS_EVERY
            if inputs_changed or self.context is None:
                self._read_config()
            if self.context is not None:  # a new context, because the views' context keeps its footage open
                self._asked = self._new_context(self.context.config)
                self._worker.ask(self._asked)
        self._notify()

    def _take_fingerprint(self) -> tuple[object, ...]:
        """A cheap fingerprint that changes with everything that a stage's status depends on."""
        assert self.take is not None
        take = self.take
        paths = [take.config, take.rig, take.edits, take.private / "stages", take.stream, take.evaluation]
        return (*(modified(path) for path in paths), self.run.outcome, len(self.run.finished))

    # The list of stages

    @property
    def busy(self) -> bool:
        """Whether a run is in progress on the take, here or elsewhere."""
        return self.job is not None or self.holder is not None

    def rows(self) -> list[StageRow]:
        return [self.row(key) for key in TITLES]

    def row(self, key: str) -> StageRow:
        if self.take is None:
            return StageRow(key, State.MISSING, "")
        if key == "capture":
            return self._capture_row()
        name = pipeline_name(key)
        status = self.assessment.stages.get(name)
        if self.busy:
            if self.run.stage == name:
                words = "stopping" if self.cancelling else "paused" if self.paused else self.run.stage_words()
                fraction = self.run.progress.fraction if self.run.progress else 0.0
                return StageRow(key, State.RUNNING, words, fraction=fraction)
            if name in self.run.finished:  # the assessment may be older
                return self._done(key, self.run.warnings.get(name, ()))
            if name in self.run.planned and name not in self.run.failed:
                return StageRow(key, State.WAITING, "waiting")
        is_done = self.assessed and status is not None and status.state == State.DONE
        if name in self.run.failed and not self.busy and not is_done:
            why, setting = self.run.failed[name], self.run.failed_setting.get(name, "")
            return StageRow(key, State.FAILED, "failed", why, setting)
        if status is None:
            return StageRow(key, State.MISSING, "" if self.assessed or self.context is None else "checking")
        if is_done:
            return self._done(key, status.warnings, why_not_done(status))
        words = "not run" if status.state == State.MISSING else status.state
        if status.state == State.PARTIAL:
            words = f"{status.units_done} of {status.units} {status.unit}"
        # that it has not run, and that earlier stages have not either, is in the list already
        return StageRow(key, State(status.state), words, "" if status.state == State.MISSING else why_not_done(status))

    def _capture_row(self) -> StageRow:
        if self.context is None:
            return StageRow("capture", State.FAILED, "no settings", self._unread)
        if self.assessment.footage_error is not None:
            error = self.assessment.footage_error
            setting = str(error.fields.get("setting", ""))
            return StageRow("capture", State.FAILED, "cannot be opened", str(error), setting)
        if not self.assessed:
            return StageRow("capture", State.MISSING, "checking")
        wrong, words = self.assessment.footage_warnings, self.assessment.footage
        initialized = self.assessment.stages.get("initialize")
        judged = initialized is not None and initialized.state == State.DONE  # it refuses what is wrong, and warns
        judged |= self.masks_judged == self.context.config.capture or self.context.config.capture.masks == "none"
        told = wrong[0] if wrong else "" if judged else NOT_JUDGED
        return StageRow("capture", State.DONE, words, told, doubts=(told,) if told else ())

    def _done(self, key: str, warnings: Sequence[Warned], detail: str = "") -> StageRow:
        """The row of a finished stage; with warnings, the worst of them."""
        if not warnings:
            return StageRow(key, State.DONE, "done", detail)
        words, told = counted(len(warnings), "warning"), doubts(warnings)
        setting = REMEDIES.get(worst_first(warnings)[0].code, "")
        return StageRow(key, State.DONE, words, told[0], setting, doubts=told)

    # Running

    def start(self, key: str, again: bool = False) -> bool:
        """Run a stage and the stages it depends on, as needed; `again` reruns a finished stage; "all" runs all stages.
        False, and `refused` is emitted, if the run cannot be started."""
        if self.take is None:
            self.refused.emit("Open a take first. A stream has no stages to run.")
            return False
        if self.busy:
            self.refused.emit("Another run is in progress on this take. Wait for it to finish, or cancel it.")
            return False
        if self.context is None:
            return False
        name = pipeline_name(key)
        arguments = ("run",) if key == "all" else (name, "--force") if again else ("run", "--until", name)
        self.run = self.run.followed()
        try:
            with disk_errors(self.take.root):
                self.job = Job(self.take, arguments)
        except (StudioError, OSError) as error:
            self.refused.emit(f"Cannot start the run: {error}")
            return False
        self.job.output.connect(self._job_output)
        self._notify()
        return True

    def note(self, text: str, failed: bool = False) -> None:
        """Add a line to the log about something else than the run."""
        self.run.note(text, failed)
        self._notify()

    def cancel(self) -> None:
        """Stop the run, wherever it was started; finished work is kept."""
        if self.job is not None:
            self.job.cancel()
            self.cancelling = True
        elif self.holder is not None:
            pid = self.pid
            if self._elsewhere:
                assert self.take is not None
                try:
                    request_cancel(self.take)
                except StudioError as error:
                    self.refused.emit(str(error))
                    return
                self.cancelling = True
            elif pid is not None and stop_process(pid):
                self.cancelling = True
            else:
                self.refused.emit(f"Cannot stop the run (process {pid}) from here. Stop it where it was started.")

    def pause(self) -> None:
        """Suspend or resume the run, wherever it was started. It stays in memory: power off loses unfinished work."""
        pid = self.pid
        if pid is None:
            return
        if self.config is not None and self.config.run.executor == "ray":
            self.refused.emit("A run on a cluster cannot be paused. Cancel it; the next run resumes it.")
            return
        if self._elsewhere:
            host = self.holder and self.holder.get("host")
            self.refused.emit(f"The run is on another machine ({host}); pause it there.")
            return
        if pause_process(pid, not self.paused):
            self.run.heard = time.monotonic()
            self.paused = not self.paused  # takes effect with a delay; `_look` reads the actual state
        else:
            self.refused.emit(f"Cannot pause the run (process {pid}) from here. Pause it where it was started.")

    @property
    def _elsewhere(self) -> bool:
        """The run in progress is on another machine, which shares the take's folder."""
        host = self.holder.get("host") if self.holder is not None else None
        return self.job is None and host not in (None, socket.gethostname())

    @property
    def pid(self) -> int | None:
        """Process ID of the run in progress on the take; None if there is none."""
        if self.job is not None:
            return self.job.pid
        pid = self.holder.get("pid") if self.holder is not None else None
        return pid if isinstance(pid, int) else None

    def change_settings(self, values: Mapping[str, object], words: str = "") -> None:
        """Write settings, by dotted name, to config.yaml as one change to undo. Raises StudioError."""
        before = self.config
        self.write_settings(values)
        now = self.config
        if before is not None and now is not None and now != before:
            old, new = ({name: setting_value(config, name) for name in values} for config in (before, now))
            changes = [
                f"{setting_words(name)} from {value_words(name, before)} to {value_words(name, now)}" for name in values
            ]
            words = words or f"the change of {', '.join(changes)}"
            self.history.add(Change(words, partial(self.write_settings, old), partial(self.write_settings, new)))

    def changeable(self) -> tuple[Take, Inputs]:
        """The take, whose settings can be changed now. Raises StudioError if they cannot."""
        if self.take is None or self.context is None:
            raise StudioError("settings.no_take", "no take with readable settings is open", fix="Open a take first.")
        if self.busy:
            fix = "Wait for it to finish, or cancel it."
            raise StudioError("settings.run_active", "settings are locked during a run", fix=fix)
        return self.take, self.context

    def write_settings(self, values: Mapping[str, object]) -> None:
        """Write settings, as `change_settings` does, without undo."""
        take, context = self.changeable()
        try:
            config = load_config(take.config, list(values.items()))
        except StudioError as error:
            message = error.message
            raise StudioError.of(replace(message, file=None) if error.file == OVERRIDES else message) from None
        if config != context.config:
            with disk_errors(take.root):
                save_config(take.config, config)  # keeps comments
            self.context = self._new_context(config)
            self._unchecked()
        self._look_soon()
        self._notify()

    def inputs_changed(self) -> None:
        """Read the take's edits again, and assess the stages soon."""
        if self.take is not None and self.context is not None:
            self.context = self._new_context(self.context.config)
            self._unchecked()
            self._look_soon()
            self._notify()


def modified(path: Path) -> int:
    """The time of the last change of a file or folder, nanoseconds since 1970; 0 if it does not exist."""
    try:
        return path.stat().st_mtime_ns
    except OSError:
        return 0
