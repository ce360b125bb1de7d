"""The tour: its steps, and what they tell about the window's state."""

from __future__ import annotations

from collections.abc import Callable

from open3d.visualization import gui

from gui.models.tour import Tour, TourFacts
from gui.shell import Shell


class TourActions:
    """See the module.

    Args:
        window: the main window.
        open_sample: opens the sample capture; returns whether there is one to open.
    """

    def __init__(self, window: Shell, open_sample: Callable[[], bool]) -> None:
        self._window, self._open_sample = window, open_sample
        self.tour = Tour()
        self._waiting = False

    def ask(self) -> None:
        """Start the tour; if nothing is open, with the sample capture."""
        window = self._window
        if window.workspace.take is not None:
            self._start()
        elif window.player.opened is None:
            self.wait()
            if not self._open_sample():
                self.failed()
        else:
            window.notices.tell("The tour shows the stages of a take. Open one, or the sample capture (H: start page).")

    def wait(self) -> None:
        """Start the tour once a take is open."""
        self._waiting = True

    def opened(self) -> None:
        """Something has been opened."""
        if self.tour.number is not None:  # it was about another take
            self.tour.stop()
        if self._waiting and self._window.workspace.take is not None:
            self._start()
        self._waiting = False

    def failed(self) -> None:
        """What was to be opened was not."""
        self._waiting = False

    def _start(self) -> None:
        window = self._window
        window.start_actions.hide()
        if window.layout.fullscreen:
            window.layout.set_fullscreen(False)
        self.tour.start()
        self._select()
        if not window.preferences.tour_shown:
            window.preferences.tour_shown = True
            window.preferences.save()

    def act(self, key: str) -> None:
        """Handle "next", "back" or "skip"."""
        {"next": self.tour.next, "back": self.tour.back, "skip": self.tour.stop}[key]()
        self._select()

    def _select(self) -> None:
        step = self.tour.step
        if step is not None:
            views = self._window.views
            views.leave_edits()
            if self._window.views.stage != step.stage:
                self._window.select(step.stage)
            self._window.laid_out()

    def facts(self) -> TourFacts:
        """The window's state."""
        window = self._window
        workspace, player, opened = window.workspace, window.player, window.player.opened
        return TourFacts(
            states={row.key: row.state for row in workspace.rows()},
            footage=workspace.assessment.footage,
            mode=window.views.capture.mode,
            alone=window.views.capture.camera,
            settings=workspace.config is not None,
            busy=workspace.busy,
            paused=workspace.paused,
            frames=player.transport.frame_count,
            evaluated=bool(window.evaluation.frames),
            sources=tuple(opened.sources) if opened is not None else (),
            cameras=bool(player.camera_names),
        )

    @property
    def words(self) -> str:
        """Text of the step; "" while there is no tour, or the control is not on screen."""
        step = self.tour.step
        if step is None or self.target is None or self._window.views.stage != step.stage:
            return ""
        return step.words(self.facts())

    @property
    def target(self) -> gui.Widget | None:
        """The control that the step is about; None if it is not on screen."""
        window, step = self._window, self.tour.step
        if step is None or window.start.shown or window.layout.fullscreen or window.views.edits_take:
            return None
        return {
            "stages": window.stages.list.widget,
            "viewport": window.viewport.picture.widget,
            "settings": window.stages.settings[window.stages.selected].widget,
            "run": window.stages.row,
            "timeline": window.timeline.picture.widget,
            "modes": window.modes.rows[window.views.row].widget,
        }[step.target]
