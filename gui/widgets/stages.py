"""The left panel: the stages with their status, run buttons, and the settings of the selected stage."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from open3d.visualization import gui

from v3studio.gui.drawing.canvas import Canvas, text_width
from v3studio.gui.drawing.palette import ACCENT, ACCENT_DARK, BAD, DIM, LINE, PANEL, RAISED, TEXT, State
from v3studio.gui.models.stage_rows import TITLES, StageRow
from v3studio.gui.models.take.estimates import Estimates
from v3studio.gui.models.take.page_words import setting_words
from v3studio.gui.models.take.settings import SettingField, stage_of
from v3studio.gui.models.take.workspace import Workspace
from v3studio.gui.widgets.hints import Hints
from v3studio.gui.widgets.picture import ImagePanel, color, make_button, make_label, put
from v3studio.gui.widgets.settings import SettingActions, SettingsList
from v3studio.gui.widgets.swap_guard import SwapGuard
from v3studio.pipelines.config import Config
from v3studio.pipelines.config.presets import PRESETS, differing, preset_of
from v3studio.studio.errors import StudioError

_HINTS = {
    "Check": "Read all images of the footage once, compare the masks, and measure time, cameras and color",
    "Run": "Run this stage and the stages it depends on",
    "Run again": "Run this stage again",
    "Pause": "Suspend the run; it stays in memory until you resume it",
    "Resume": "Resume the run",
}

GRIP = 0.55  # width in em of the edge that is dragged to make the panel wider or narrower


class StagesPanel:
    """The left panel. `run`: called with a stage's key ("all" for all stages) and whether to rerun a finished stage.
    `pick`: called with a setting whose file or folder is to be chosen in a dialog. `widen`: called while the panel's
    right edge is dragged, with the column of the window and whether that was all. `show_help`: called when help on the
    selected stage is wanted. `guard`: notified when Run and Run all take turns with Pause and Cancel."""

    def __init__(
        self,
        workspace: Workspace,
        em: float,
        select: Callable[[str], None],
        run: Callable[[str, bool], None],
        changed: Callable[[], None],
        pick: Callable[[SettingField], None],
        widen: Callable[[float, bool], None],
        show_help: Callable[[], None],
        guard: SwapGuard,
        hints: Hints,
    ) -> None:
        self._workspace, self._em = workspace, em
        self._select, self._run, self._changed = select, run, changed
        self._guard, self._hints = guard, hints
        self.selected = "review"
        self.upcoming = ""
        self.list = ImagePanel(self._on_mouse)
        self.ground = gui.Vert()  # behind messages
        self.ground.background_color = color(PANEL)
        self.detail = make_label("", DIM, PANEL)
        self.buttons: dict[str, gui.Button] = {}
        pad, gap = round(0.6 * em), round(0.4 * em)
        self.row = gui.Horiz(gap, gui.Margins(pad, gap, pad, gap))
        self.row.background_color = color(PANEL)
        self._button("all", "Run all", "Run all stages that are not up to date", lambda: run("all", False))
        self._button("run", "Run", _HINTS["Run"], self._run_clicked)
        self._button("pause", "Pause", _HINTS["Pause"], workspace.pause)
        words = "Stop the run; finished work is kept, and the next run resumes from there"
        self.link = make_button("", self._go_to_setting)
        self.link.tooltip = "Show the setting that fixes this"
        self._button("cancel", "Cancel", words, workspace.cancel)
        self.row.add_stretch()
        self._button("help", "?", "What to look for in this stage (F1)", show_help)
        self._refused_setting = ""
        self._error_in: object = None
        self.error = make_label("", BAD, PANEL)
        self.estimates = Estimates()
        self.estimates.changed.connect(self._show_estimates)
        actions = SettingActions(self.set_text, self._reset, self._choose, pick, self._estimate, changed)
        self.settings = {stage: SettingsList(stage, em, actions, self.estimates) for stage in TITLES}
        for widget in (self.detail, self.error, self.link, *(panel.widget for panel in self.settings.values())):
            widget.visible = False  # until there is something to show
        self._shown_config: Config | None = None
        self._widening = False
        self._widen = widen

    @property
    def widgets(self) -> list[gui.Widget]:
        """All widgets, to be added to the window."""
        lists = [panel.widget for panel in self.settings.values()]
        return [self.list.widget, self.ground, self.detail, self.row, self.error, self.link, *lists]

    def set_visible(self, on: bool) -> None:
        """Hide or show the panel; call `update` afterwards."""
        for widget in self.widgets:
            widget.visible = on and widget in (self.list.widget, self.ground, self.row)

    def _button(self, key: str, text: str, tooltip: str, action: Callable[[], None]) -> None:
        def guarded() -> None:
            if not self._guard.refuses():
                action()

        button = self.buttons[key] = make_button(text, guarded, self._changed)
        self._hints.give(button, tooltip, self.row)
        self.row.add_child(button)

    def _run_clicked(self) -> None:
        row = self._workspace.row(self.selected)
        self._run(self.selected, row.state == State.DONE)

    def _on_mouse(self, event: gui.MouseEvent, x: float, y: float) -> bool:
        kind = gui.MouseEvent.Type
        if event.type == kind.BUTTON_DOWN:
            self._widening = x > self.list.size[0] - GRIP * self._em
        if self._widening and event.type in (kind.BUTTON_DOWN, kind.DRAG, kind.BUTTON_UP):
            if event.type != kind.BUTTON_DOWN:
                self._widen(self.list.widget.frame.x + x, event.type == kind.BUTTON_UP)
            self._widening = event.type != kind.BUTTON_UP
            self._changed()
            return True
        if event.type == kind.MOVE:
            at_edge = x > self.list.size[0] - GRIP * self._em
            self.list.widget.tooltip = "Drag to make the panel wider or narrower" if at_edge else ""
        if event.type != kind.BUTTON_DOWN:
            return event.type != kind.WHEEL
        row = int(y // _row_height(self._em))
        if 0 <= row < len(TITLES):
            self._refuse(None)  # the message concerned a setting of the other stage
            self._select(list(TITLES)[row])
            self._changed()
        return True

    def _estimate(self) -> None:
        take = self._workspace.take
        if self._workspace.busy:
            self._say("A run is in progress. Estimate when it has finished: both would take longer.")
        elif take is not None:
            self.estimates.start(take)

    def _say(self, text: str) -> None:
        self._refuse(None)
        put(self.error, text=text)

    def _reset(self, names: list[str]) -> None:
        config = self._workspace.config
        if config is not None:
            usual = differing(config, preset_of(config))
            self._write(lambda: {name: usual[name] for name in names if name in usual})

    def _choose(self, preset: str) -> None:
        self._write(lambda: PRESETS[preset], f"the preset {preset}")

    def set_text(self, field: SettingField, text: str) -> None:
        """Set a setting to a text, as if it were typed."""
        self._write(lambda: {field.name: field.parsed(text)}, edited=field.name)

    def _write(self, settings: Callable[[], Mapping[str, object]], words: str = "", edited: str = "") -> None:
        refusal = None
        try:
            self._workspace.change_settings(settings(), words)
        except StudioError as error:
            refusal = error
        self._refuse(refusal, edited)
        self._shown_config = None  # shows the actual value, even if the new one was refused
        self._changed()

    def _refuse(self, refusal: StudioError | None, edited: str = "") -> None:
        """Show why a setting was refused; None clears it."""
        text = "" if refusal is None else str(refusal)
        setting = "" if refusal is None else str(refusal.fields.get("setting", ""))
        self._refused_setting = setting if setting != edited else ""  # the edited one is already on screen
        self._error_in = self._circumstances
        put(self.error, text=text)

    @property
    def _circumstances(self) -> object:
        """The circumstances in which the error on screen is true: the settings, and whether a run is in progress."""
        return self._workspace.context, self._workspace.busy

    @property
    def error_setting(self) -> str:
        """The setting that fixes the error on screen; "" if there is none."""
        setting = self._refused_setting or self._workspace.row(self.selected).setting
        return setting if stage_of(setting) else ""

    def _go_to_setting(self) -> None:
        if self.error_setting:
            self.show_setting(self.error_setting)

    def show_setting(self, setting: str) -> None:
        """Select the stage of a setting and search for it."""
        self._select(stage_of(setting))
        self.settings[self.selected].find(setting)
        self._changed()

    # Layout and state

    def place(self, x: float, y: float, width: float, height: float, context: gui.LayoutContext) -> None:
        """Set the panel's rectangle in window pixels."""
        em = self._em
        list_height = _row_height(em) * len(TITLES)
        self.list.place(x, y, width, list_height)
        top = y + list_height + 2.5 * em
        limits = gui.Widget.Constraints()
        limits.width = int(width - 1.2 * em)
        self.row.frame = gui.Rect(int(x), int(y + list_height), int(width), int(top) - int(y + list_height))
        end = y + height
        # messages come last, so that neither buttons nor fields move when one appears
        if self.link.text:
            wide = self.link.calc_preferred_size(context, limits).width
            end -= 1.8 * em
            self.link.frame = gui.Rect(int(x + 0.6 * em), int(end), int(min(wide, limits.width)), int(1.5 * em))
        for label, most in ((self.error, 8), (self.detail, 6)):
            if label.text:
                wanted = min(label.calc_preferred_size(context, limits).height + 0.3 * em, most * em)
                end -= wanted + 0.3 * em
                label.frame = gui.Rect(int(x + 0.6 * em), int(end), limits.width, int(wanted))
        for panel in self.settings.values():
            panel.place(x, top, width, max(end - top, 1), context)
        if self._workspace.config is None:
            end = top
        self.ground.frame = gui.Rect(int(x), int(end), int(width), int(y + height) - int(end))

    def update(self) -> tuple[bool, bool]:
        """Show the state of the workspace; return (whether anything changed, whether a layout is due)."""
        rows = self._workspace.rows()
        changed = self.list.update(
            (rows, self.selected, self.list.size),
            lambda: list_image(rows, self.selected, self.list.size[0], self._em),
        )
        if self._error_in != self._circumstances:
            self._refuse(None)
        row = self._workspace.row(self.selected)
        config, setting = self._workspace.config, self.error_setting
        link = f"Go to {setting_words(setting)}" if setting else ""
        detail = f"{row.detail[:1].upper()}{row.detail[1:].rstrip('.')}." if row.detail else ""
        layout = put(self.detail, text=detail, visible=bool(detail)) | put(self.link, text=link, visible=bool(link))
        layout |= put(self.error, visible=bool(self.error.text))
        for stage, panel in self.settings.items():
            layout |= put(panel.widget, visible=stage == self.selected and config is not None)
        if self.estimates.show(self._workspace.take, config):
            self._show_estimates()
        self.settings["calibrate"].camera_file = self._workspace.assessment.camera_file
        if self.settings[self.selected].refilter():
            self._shown_config = None
            layout = True
        if config is not None and config is not self._shown_config:
            self._shown_config = config
            for panel in self.settings.values():
                panel.show(config)
            layout = True
        layout |= self._update_buttons(row.state, rows)  # a new text has another width
        return changed or layout, layout

    def _show_estimates(self) -> None:
        """Show what is known about the presets."""
        estimates = self.estimates
        if estimates.failure:
            self._say(f"The presets could not be estimated: {estimates.failure}")
            estimates.failure = ""
        for panel in self.settings.values():
            panel.show_estimates()
            panel.estimate.enabled = not estimates.running
            panel.estimate.text = "Estimating ..." if estimates.running else "Estimate"
        self._shown_config = None  # lay the settings out again
        self._changed()

    def _update_buttons(self, state: State, rows: Sequence[StageRow]) -> bool:
        changed = False
        busy = self._workspace.busy
        there = self._workspace.config is not None
        run = "Check" if self.selected == "capture" else "Run again" if state == State.DONE else "Run"
        for key, text in (("run", run), ("pause", "Resume" if self._workspace.paused else "Pause")):
            if put(self.buttons[key], text=text):
                self._hints.give(self.buttons[key], _HINTS[text], self.row)
                changed = True
        to_do = run == "Check" and state == State.DONE and any(row.state != State.DONE for row in rows)
        upcoming = "all" if to_do else "run" if run == "Run" else ""
        if self.upcoming != upcoming:  # only what is to be done next stands out
            for key in ("all", "run"):
                self.buttons[key].background_color = color(ACCENT_DARK if key == upcoming else RAISED)
            self.upcoming, changed = upcoming, True
        stoppable = busy and not self._workspace.cancelling
        for key, enabled in {"run": there, "all": there, "pause": stoppable, "cancel": stoppable}.items():
            button, shown = self.buttons[key], busy == (key in ("pause", "cancel"))
            if button.visible != shown:
                self._guard.swapped()
            changed |= put(button, enabled=enabled, visible=shown)
        return changed


def _row_height(em: float) -> float:
    """Height of a row of the list, pixels."""
    return round(2.3 * em)


def list_image(rows: Sequence[StageRow], selected: str, width: int, em: float) -> np.ndarray:
    """(height, width, 3) uint8: status dot, title, words and progress bar of each stage."""
    each = _row_height(em)
    canvas = Canvas(width, each * len(rows), PANEL)
    size, small = round(em), round(0.82 * em)
    for number, row in enumerate(rows):
        y = number * each
        if row.key == selected:
            canvas.rect(0, y, width, each, RAISED)
            canvas.rect(0, y, 3, each, ACCENT)
        color = row.color
        middle = y + each / 2
        canvas.dot(1.2 * em, middle, 0.32 * em, color, filled=row.state not in (State.MISSING, State.WAITING))
        title = canvas.text(2.2 * em, middle - 0.62 * size, row.title, size, TEXT)
        room = width - 2.2 * em - title - 1.2 * em
        words = row.words
        if text_width(words, small) > room and "," in words:
            words = words.split(",")[0]
        plain = row.state in (State.DONE, State.MISSING, State.WAITING) and not row.doubts
        color = DIM if plain else color
        canvas.text(width - 0.6 * em, middle - 0.62 * small, words, small, color, align="right", width=room)
        if row.state == State.RUNNING:
            canvas.rect(2.2 * em, y + each - 4, width - 2.8 * em, 2, LINE)
            canvas.rect(2.2 * em, y + each - 4, (width - 2.8 * em) * min(max(row.fraction or 0.0, 0.0), 1.0), 2, ACCENT)
    for number in range(-1, 2):  # the edge that is dragged
        canvas.rect(width - 4, canvas.height / 2 + number * 6 - 1, 2, 2, DIM)
    return canvas.pixels
