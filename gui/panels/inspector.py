"""The right panel: figures of the selected stage, and the job log."""

from __future__ import annotations

import time
from collections.abc import Callable

from open3d.visualization import gui

from gui.panels.picture import PictureWidget
from gui.presenters.evaluation import Evaluation
from gui.presenters.marks import Marks
from gui.presenters.playback.player import PlayerPresenter
from gui.presenters.run.inspector import (
    Block,
    figures_height,
    figures_picture,
    log_lines,
    log_picture,
    review_blocks,
    run_blocks,
)
from gui.presenters.run.workspace import Workspace

PAUSE = 0.25
"""Minimum seconds between two updates of the figures of the same frame."""


class InspectorPanel:
    """See the module.

    Args:
        em: font size, pixels.
        changed: called when the log is scrolled.

    Attributes:
        frame: the frame whose figures are shown; None before the first.
    """

    def __init__(self, em: float, changed: Callable[[], None]) -> None:
        self._em, self._changed = em, changed
        self.figures = PictureWidget(self._on_figures)
        self.log = PictureWidget(self._on_mouse)
        self._back = 0
        self._down, self._blocks = 0.0, list[Block]()
        self._figures_of: object = None
        self._log_of: object = None
        self._lines: list[tuple[str, str]] = []
        self._lines_of: tuple[object, ...] = (None,)
        self._next = 0.0
        self._of: object = None
        self.frame: int | None = None

    @property
    def widgets(self) -> list[gui.Widget]:
        """All widgets, to be added to the window."""
        return [self.figures.widget, self.log.widget]

    def place(self, x: float, y: float, width: float, height: float) -> None:
        """Set the panel's rectangle in window pixels."""
        share = round(0.72 * height)
        self.figures.place(x, y, width, share)
        self.log.place(x, y + share, width, height - share)

    def update(
        self,
        player: PlayerPresenter,
        evaluation: Evaluation,
        marks: Marks,
        workspace: Workspace,
        stage: str,
        drawn_rate: float,
    ) -> bool:
        """Redraw what has changed; return whether anything did."""
        changed = self._update_log(workspace)
        of = (player.frame, player.what, player.mode, player.camera, stage)  # shown everywhere in the same draw
        if time.monotonic() < self._next and of == self._of:
            return changed
        self._next, self._of = time.monotonic() + PAUSE, of
        self.frame = player.frame
        blocks = review_blocks(player, evaluation, marks, drawn_rate)
        if stage != "review" and workspace.take is not None:
            blocks = blocks[:1]
        blocks = [*run_blocks(workspace, stage), *blocks]
        self._blocks = blocks
        self._scroll(0.0)
        state = (blocks, self.figures.size, self._down)
        if state == self._figures_of:
            return changed
        self._figures_of = state
        self.figures.show(figures_picture(blocks, *self.figures.size, self._em, self._down))
        return True

    def _scroll(self, pixels: float) -> None:
        width, height = self.figures.size
        most = max(figures_height(self._blocks, width, self._em) - height, 0.0)
        self._down = min(max(self._down + pixels, 0.0), most)

    def _on_figures(self, event: gui.MouseEvent, x: float, y: float) -> bool:
        if event.type != gui.MouseEvent.Type.WHEEL:
            return False
        self._scroll(-2 * self._em * event.wheel_dy)
        self._next = 0.0
        self._changed()
        return True

    def _update_log(self, workspace: Workspace) -> bool:
        run, size = workspace.run, self.log.size
        lines_of = (id(run), len(run.lines), run.lines[-1] if run.lines else None, size[0])
        if lines_of != self._lines_of:
            if id(run) != self._lines_of[0]:
                self._back = 0
            self._lines_of = lines_of
            self._lines = log_lines(run.lines, size[0], self._em, run.times)
        state = (len(self._lines), self._lines[-1:], self._back, size)
        if state == self._log_of:
            return False
        self._log_of = state
        self.log.show(log_picture(self._lines, *size, self._em, self._back))
        return True

    def _on_mouse(self, event: gui.MouseEvent, x: float, y: float) -> bool:
        if event.type != gui.MouseEvent.Type.WHEEL:
            return False
        self._back = min(max(self._back + round(3 * event.wheel_dy), 0), max(len(self._lines) - 3, 0))
        self._changed()
        return True
