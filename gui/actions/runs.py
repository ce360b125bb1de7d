"""Running stages, and closing the window while a stage runs."""

from collections.abc import Callable

from v3studio.gui.models.stage_rows import TITLES
from v3studio.gui.models.take.exports import Exports
from v3studio.gui.models.take.workspace import Workspace
from v3studio.gui.pages.stage_views import StageViews
from v3studio.gui.platform.closing import CloseRequests
from v3studio.gui.widgets.dialogs.base import Dialogs

Question = tuple[str, str, Callable[[], object]]  # key, label and action of an answer


class RunActions:
    """Runs stages of the open take, after asking where results would be lost."""

    def __init__(
        self, workspace: Workspace, views: StageViews, exports: Exports, dialogs: Dialogs, closing: CloseRequests
    ) -> None:
        self._workspace, self._views, self._exports = workspace, views, exports
        self._dialogs, self._closing = dialogs, closing

    def run(self, stage: str, again: bool) -> None:
        """Run a stage, or check the footage."""
        if stage == "capture":
            self._views.capture.check()
            return

        def start() -> None:
            if self._workspace.start(stage, again) and stage != "all":
                self._views.select(stage)

        if not again or stage in ("bake", "review"):
            start()
            return
        self._dialogs.ask(
            f"Run {TITLES[stage]} again?",
            "Nothing that this stage depends on has changed, so the result would be the same.\n"
            "Its current results are deleted first and are lost if you cancel the run.",
            [("again", "Run again", start), ("stay", "Cancel", lambda: None)],
        )

    def close_if_asked(self) -> bool:
        """Close the window if that is requested, or ask what to do with a run or an export; returns whether it asked.
        Call at each tick."""
        if not self._closing.due():
            return False
        title, lines, answers = self._left_behind()
        if not lines:
            self._closing.wanted = True
            return False

        def closing(action: Callable[[], object]) -> Callable[[], None]:
            def close() -> None:
                action()
                self._closing.wanted = True

            return close

        rows = [(key, label, closing(action)) for key, label, action in answers]
        self._dialogs.ask(title, "\n".join(lines), [*rows, ("stay", "Cancel", lambda: None)])
        return True

    def _left_behind(self) -> tuple[str, list[str], list[Question]]:
        """Return what goes on or is lost without the window: a title, sentences and answers; no sentences if nothing
        is."""
        workspace, exports, lines = self._workspace, self._exports, list[str]()
        answers: list[Question] = [("leave", "Close", lambda: None)]
        title = "An export is in progress"
        if workspace.paused:
            title = "The run is paused"
            lines.append("It stays paused, and in memory, until you open the take again and resume it.")
            answers = [("resume", "Resume and leave running", workspace.pause), ("leave", "Leave paused", lambda: None)]
        elif workspace.job is not None:
            title = "A run is in progress"
            lines.append("It can continue without the window; open the take again to follow it.")
            answers = [("leave", "Leave running", lambda: None)]
        if lines:
            lines.append("If you stop it, finished work is kept and the next run resumes from there.")
            answers.append(("stop", "Stop run", workspace.cancel))
        if exports.running:
            lines.append(f"The {exports.does} ends with the window, unfinished.")
        return title, lines, answers
