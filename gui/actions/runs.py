"""Running stages, and closing the window while a stage runs."""

from v3studio.gui.models.stage_rows import TITLES
from v3studio.gui.models.take.workspace import Workspace
from v3studio.gui.pages.stage_views import StageViews
from v3studio.gui.platform.closing import CloseRequests
from v3studio.gui.widgets.dialogs.base import Dialogs


class RunActions:
    """Runs stages of the open take, after asking where results would be lost."""

    def __init__(
        self, workspace: Workspace, views: StageViews, dialogs: Dialogs, close_requests: CloseRequests
    ) -> None:
        self._workspace, self._views, self._dialogs, self._closing = workspace, views, dialogs, close_requests

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
        """Close the window if that is requested, or ask what to do with the job that runs; returns whether it asked.
        Call at each tick."""
        if not self._closing.due():
            return False
        if self._workspace.job is None:
            self._closing.wanted = True
            return False
        self._ask_about_job()
        return True

    def _ask_about_job(self) -> None:
        def leave() -> None:
            self._closing.wanted = True

        def stop() -> None:
            self._workspace.cancel()
            self._closing.wanted = True

        self._dialogs.ask(
            "A run is in progress",
            "It can continue without the window; open the take again to follow it.\n"
            "If you stop it, finished work is kept and the next run resumes from there.",
            [("leave", "Leave running", leave), ("stop", "Stop run", stop), ("stay", "Cancel", lambda: None)],
        )
