"""Reports that models make on their own: a run that is refused, an export that has ended, marks that have changed."""

from collections.abc import Callable
from functools import partial

from v3studio.gui.models.loop import LOOP
from v3studio.gui.models.marks import Marks
from v3studio.gui.models.notices import Notices
from v3studio.gui.models.take.exports import Exports
from v3studio.gui.models.take.workspace import Workspace
from v3studio.pipelines.events import as_message

LOOK_EVERY = 0.5  # seconds between two looks at the file of the marks, which browsers also change


class Reports:
    """Turns what models report into notices."""

    def __init__(
        self, workspace: Workspace, exports: Exports, marks: Marks, notices: Notices, changed: Callable[[], None]
    ) -> None:
        self._workspace, self._exports, self._marks, self._notices = workspace, exports, marks, notices
        self._changed = changed
        workspace.refused.connect(self._refused)
        workspace.changed.connect(self._forget_refusals)
        workspace.run_ended.connect(partial(notices.show, topic="run"))  # the words, and whether they are bad
        exports.finished.connect(self._exported)
        LOOP.every(LOOK_EVERY, self._look_at_marks)

    def _refused(self, why: str) -> None:
        self._notices.show(why, bad=True, topic="busy" if self._workspace.busy else "run")

    def _forget_refusals(self) -> None:
        """Drop what holds no more: a run in progress forbids what is allowed after it."""
        self._notices.clear("run" if self._workspace.busy else "busy")

    def _exported(self) -> None:
        exports, notices = self._exports, self._notices
        if not exports.failed:
            notices.clear("export")
        stays = exports.request is not None and exports.request.stays
        notices.show(exports.result, exports.failed, exports.written, topic="export", stays=stays)
        self._workspace.note(" ".join(f"{line.rstrip('.')}." for line in exports.result.splitlines()), exports.failed)
        self._changed()

    def _look_at_marks(self) -> None:
        if self._marks.refresh():  # somebody marked a frame in a browser
            self.tell_damage()
            self._changed()

    def tell_damage(self) -> None:
        """Report that the file of the marks is damaged, or is not anymore."""
        self._notices.outcome("marks file", str(self._marks.damage or ""))

    def failed(self, error: Exception) -> None:
        """Report what a callback raised; an open dialog stays."""
        message = as_message(error)
        bug = "\nThis is a bug in V3 Studio; the terminal shows the details." if message.code == "program.bug" else ""
        self._notices.show(f"{message}{bug}", bad=True)
        self._changed()
