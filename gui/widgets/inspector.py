"""The right panel: figures of the selected stage, and the job log."""

import time
from collections.abc import Callable, Sequence

import numpy as np
from open3d.visualization import gui

from v3studio.gui.models.evaluation import Evaluation
from v3studio.gui.models.marks import Marks
from v3studio.gui.models.playback.player import PlayerPresenter
from v3studio.gui.models.take.inspector import Block, figures_height, figures_picture, review_blocks, run_blocks
from v3studio.gui.models.take.log import LogRow, LogView, grouped, log_rows
from v3studio.gui.models.take.remedies import Fix
from v3studio.gui.models.take.workspace import Workspace
from v3studio.gui.widgets.picture import ImagePanel

PAUSE = 0.25  # minimum seconds between two updates of the figures of the same frame
LEAST_LOG = 7.0  # height in em that the figures leave to the log
LEAST_DRAGGED = 3.5  # least height in em of the figures and of the log after the edge between them has been dragged

TOOLTIPS = {  # of buttons in the log, by whether they change a setting
    True: "Change the setting; Ctrl+Z changes it back. Run the stage again to use it.",
    False: "Show the setting",
}

EDGE_TOOLTIPS = {False: "Drag to resize the log; click to enlarge it (J)", True: "Click to make it small again (J)"}
"""Tooltips of the heading of the log, by whether it is large."""

STILL = 3  # pixels that the pointer may move during a click


class InspectorPanel:
    """Shows the figures and the log, whose edge can be dragged."""

    def __init__(
        self, player: PlayerPresenter, workspace: Workspace, marks: Marks, em: float, changed: Callable[[], None],
        apply_fix: Callable[[Fix], None], laid_out: Callable[[], None],
    ) -> None:  # fmt: skip
        self._player, self._workspace, self._marks = player, workspace, marks
        self._em, self._changed, self._apply_fix, self._laid_out = em, changed, apply_fix, laid_out
        self.figures = ImagePanel(self._on_figures)
        self.log = ImagePanel(self._on_mouse)
        # the selected stage; Review has more figures than others, which leave more room to the log
        self._stage = "review"
        self.large = False  # whether the log covers the view
        self.log_height: float | None = None  # height of the log as dragged, em; None for what the figures leave
        self.only_warnings = False  # whether the log shows warnings and errors only
        self._warnings = 0
        self._grabbed: float | None = None  # where the edge of the log was pressed, pixels below it
        self._dragging = False
        self._back = 0
        self._place = (0.0, 0.0, 16.0, 16.0)
        self._over = self._place
        self._placed: object = None
        self._down, self._blocks = 0.0, list[Block]()
        self.view = LogView([], 16, 16, em)  # the log as it was drawn last
        self._rows: list[LogRow] = []
        self._lines_of: tuple[object, ...] = (None,)
        self._next = 0.0
        self._of: object = None
        self.frame: int | None = None

    def toggle(self) -> None:
        """Show the log over the view, or in its panel again; needs a layout."""
        self.large = not self.large
        self._laid_out()

    def toggle_warnings(self) -> None:
        """Show warnings and errors only, or all lines of the log again."""
        self.only_warnings = not self.only_warnings
        self._back = 0
        self._changed()

    @property
    def widgets(self) -> list[gui.Widget]:
        """All widgets, to be added to the window."""
        return [self.figures.widget, self.log.widget]

    def place(self, x: float, y: float, width: float, height: float, over: tuple[float, float, float, float]) -> None:
        """Set the panel's rectangle in window pixels; `over`: that of the log while it is large."""
        self._place = (x, y, width, height)
        self._over = over
        self._share()

    def _share(self) -> None:
        """Divide the panel: the figures get what they need, but leave some lines to the log."""
        x, y, width, height = self._place
        usual = (0.72 if self._stage == "review" else 0.5) * height
        needed = figures_height(self._blocks, int(width), self._em) if self._blocks else 0.0
        share = round(max(min(needed, height - LEAST_LOG * self._em), usual))
        if self.log_height is not None:
            least = LEAST_DRAGGED * self._em
            share = round(max(min(height - self.log_height * self._em, height - least), least))
        if self.large:
            share = round(height)
        places = (self._place, self._over, share, self.large)
        if self._placed != places:
            self._placed = places
            self.figures.place(x, y, width, share)
            self.log.place(*(self._over if self.large else (x, y + share, width, height - share)))

    def update(self, stage: str, of_stage: Sequence[Block], evaluation: Evaluation, camera: str) -> bool:
        """Redraw what has changed; returns whether anything did. `camera`: whose quality is shown; "" for the mean."""
        return self._update_figures(stage, of_stage, evaluation, camera) | self._update_log()

    def _update_figures(self, stage: str, of_stage: Sequence[Block], evaluation: Evaluation, camera: str) -> bool:
        player, workspace, self._stage = self._player, self._workspace, stage
        of = (player.frame, player.what, player.mode, player.camera, stage, camera)  # shown everywhere in the same draw
        if time.monotonic() < self._next and of == self._of:
            return False
        self._next, self._of = time.monotonic() + PAUSE, of
        self.frame = player.frame
        blocks = review_blocks(player, evaluation, self._marks, camera)
        if stage != "review" and workspace.take is not None:
            blocks = blocks[:1]
        blocks = [*run_blocks(workspace, stage), *of_stage, *blocks]
        self._blocks = blocks
        self._share()
        self._scroll(0.0)
        size, down = self.figures.size, self._down
        return self.figures.update((blocks, size, down), lambda: figures_picture(blocks, *size, self._em, down))

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

    def _update_log(self) -> bool:
        """Redraw the log, in the size that the figures leave, if it has changed; return whether it has."""
        workspace, run, size = self._workspace, self._workspace.run, self.log.size
        last = run.lines[-1] if run.lines else None
        lines_of = (id(run), len(run.lines), last, size[0], id(workspace.config), self.only_warnings)
        if lines_of != self._lines_of:
            if id(run) != self._lines_of[0]:
                self._back = 0
            self._lines_of = lines_of
            lines = grouped(run.lines)
            warnings = [line for line in lines if line.level]
            self._warnings = len(warnings)
            lines = warnings if self.only_warnings else lines
            self._rows = log_rows(lines, size[0], self._em, workspace.config)
        view = LogView(self._rows, *size, self._em, self._back, self.large, self._warnings, self.only_warnings)
        state = (view.shown, view.back, size, view.large, view.warnings, view.only_warnings)

        def draw() -> np.ndarray:
            self.view = view
            return view.picture()

        return self.log.update(state, draw)

    def _on_edge(self, event: gui.MouseEvent, y: float) -> bool:
        """Resize the log by a drag of its heading; a click enlarges it, or undoes that. Returns whether it was one."""
        kind = gui.MouseEvent.Type
        if event.type == kind.BUTTON_DOWN:
            self._grabbed, self._dragging = (y, False) if y < self.view.top else (None, False)
        if self._grabbed is None:
            return False
        _, top, _, height = self._place
        if event.type == kind.DRAG and not self.large:
            edge = self.log.widget.frame.y + y - self._grabbed
            self._dragging |= abs(y - self._grabbed) > STILL
            if self._dragging:
                self.log_height = float(round((top + height - edge) / self._em))  # each size needs a texture of its own
                self._share()
        elif event.type == kind.BUTTON_UP:
            self._grabbed = None
            if not self._dragging:
                self.toggle()
        self._changed()
        return True

    def _on_mouse(self, event: gui.MouseEvent, x: float, y: float) -> bool:
        kind = gui.MouseEvent.Type
        label = self.view.areas.at(x, y) or ""
        fix = self.view.fixes.get(label)
        on_filter = label != "" and fix is None
        if event.type == kind.BUTTON_DOWN and on_filter:
            self._grabbed = None
            self.toggle_warnings()
            return True
        if event.type in (kind.BUTTON_DOWN, kind.DRAG, kind.BUTTON_UP) and self._on_edge(event, y):
            return True
        if event.type == kind.BUTTON_DOWN:
            if fix is not None:
                self._apply_fix(fix)
                self._changed()
            return fix is not None
        if event.type == kind.MOVE:
            tooltip = "" if fix is None or fix.camera else TOOLTIPS[fix.sets and not fix.done]
            if y < self.view.top:
                tooltip = "" if on_filter else EDGE_TOOLTIPS[self.large]
            self.log.widget.tooltip = tooltip
            return False
        if event.type != kind.WHEEL:
            return False
        self._back = min(max(self._back + round(3 * event.wheel_dy), 0), max(len(self._rows) - 3, 0))
        self._changed()
        return True
