"""The left side: the stages with their state, the selected one's settings, Run and Cancel."""

from __future__ import annotations

from collections.abc import Callable

from open3d.visualization import gui

from gui.panels.picture import PictureWidget, color
from gui.panels.settings import SettingsList
from gui.presenters.drawing.palette import ACCENT_DARK, BAD, DIM, PANEL, RAISED
from gui.presenters.run.settings import SettingField
from gui.presenters.run.workspace import Workspace
from gui.presenters.stages import stage_list
from gui.presenters.stages.stage_rows import TITLES
from pipelines.config import Config

_PAUSE = {
    "Pause": "Halt the run where it stands; it keeps its memory and goes on when you resume it",
    "Resume": "Let the run go on",
}


class StagesPanel:
    """See the module.

    Args:
        workspace: the take.
        em: font size, pixels.
        select: called with a stage's key.
        run: called with a stage's key and whether to run it once more; "all" for all stages.
        changed: called whenever something here was touched.
    """

    def __init__(
        self,
        workspace: Workspace,
        em: float,
        select: Callable[[str], None],
        run: Callable[[str, bool], None],
        changed: Callable[[], None],
    ) -> None:
        self._workspace, self._em = workspace, em
        self._select, self._run, self._changed = select, run, changed
        self.selected = "review"
        self._drawn: object = None
        self.list = PictureWidget(self._on_mouse)
        self.ground = gui.Vert()  # behind what has no background of its own
        self.ground.background_color = color(PANEL)
        self.detail = gui.Label("")
        self.detail.text_color = color(DIM)
        self.detail.background_color = color(PANEL)
        self.buttons: dict[str, gui.Button] = {}
        self.row = gui.Horiz(0.4 * em)
        self.row.background_color = color(PANEL)
        self._button("run", "Run", "Do what is needed until this stage is done", self._run_clicked)
        self._button("all", "Run all", "Bring every stage up to date", lambda: run("all", False))
        self._button("pause", "Pause", _PAUSE["Pause"], workspace.pause)
        words = "Stop; what is finished is kept, and a later run goes on from there"
        self._button("cancel", "Cancel", words, workspace.cancel)
        self.row.add_stretch()
        self.error = gui.Label("")
        self.error.text_color = color(BAD)
        self.error.background_color = color(PANEL)
        self.settings = {stage: SettingsList(stage, em, self._set, changed) for stage in TITLES}
        for widget in (self.detail, self.error, *(panel.widget for panel in self.settings.values())):
            widget.visible = False  # until there is something to show
        self._shown_config: Config | None = None

    @property
    def widgets(self) -> list[gui.Widget]:
        """All that the window must hold."""
        lists = [panel.widget for panel in self.settings.values()]
        return [self.list.widget, self.ground, self.detail, self.row, self.error, *lists]

    def set_visible(self, on: bool) -> None:
        """Hide all of it, or show it again; `update` then shows what depends on the state."""
        for widget in self.widgets:
            widget.visible = on and widget in (self.list.widget, self.ground, self.row)

    def _button(self, key: str, text: str, tooltip: str, action: Callable[[], None]) -> None:
        button = gui.Button(text)
        button.tooltip = tooltip
        button.vertical_padding_em = 0.1
        button.horizontal_padding_em = 0.7
        button.background_color = color(RAISED if key != "run" else ACCENT_DARK)

        def clicked() -> None:
            action()
            self._changed()

        button.set_on_clicked(clicked)
        self.row.add_child(button)
        self.buttons[key] = button

    def _run_clicked(self) -> None:
        row = self._workspace.row(self.selected)
        self._run(self.selected, row.state == "done")

    def _on_mouse(self, event: gui.MouseEvent, x: float, y: float) -> bool:
        if event.type != gui.MouseEvent.Type.BUTTON_DOWN:
            return event.type != gui.MouseEvent.Type.WHEEL
        row = stage_list.row_at(y, self._em, len(TITLES))
        if row is not None:
            self._say("")  # it was about a setting of the stage that was shown
            self._select(list(TITLES)[row])
            self._changed()
        return True

    def _set(self, field: SettingField, text: str) -> None:
        from studio.errors import StudioError

        try:
            wrong = self._workspace.change_setting(field.name, field.parsed(text))
        except StudioError as error:
            wrong = str(error)
        self._say(wrong)
        self._shown_config = None  # shows what holds, also where the new value was refused
        self._changed()

    def _say(self, text: str) -> None:
        if self.error.text != text:
            self.error.text = text

    # Layout and state

    def place(self, x: float, y: float, width: float, height: float, context: gui.LayoutContext) -> None:
        """Take this rectangle of the window (pixels)."""
        em = self._em
        list_height = stage_list.row_height(em) * len(TITLES)
        self.list.place(x, y, width, list_height)
        top = y + list_height + 0.4 * em
        limits = gui.Widget.Constraints()
        limits.width = int(width - 1.2 * em)
        # the buttons first: they stay where they are, whatever there is to say
        self.row.frame = gui.Rect(int(x + 0.6 * em), int(top), limits.width, int(1.7 * em))
        top += 2.1 * em
        for label, most in ((self.detail, 6), (self.error, 8)):
            if label.text:
                wanted = min(label.calc_preferred_size(context, limits).height + 0.3 * em, most * em)
                label.frame = gui.Rect(int(x + 0.6 * em), int(top), limits.width, int(wanted))
                top += wanted + 0.3 * em
        for panel in self.settings.values():
            panel.place(x, top, width, max(y + height - top, 1))
        end = top if self._workspace.config is not None else y + height
        self.ground.frame = gui.Rect(int(x), int(y + list_height), int(width), int(end - y - list_height))

    def update(self) -> tuple[bool, bool]:
        """Bring everything in line with the workspace; returns (whether something changed, whether to lay out anew)."""
        changed = layout = False
        rows = self._workspace.rows()
        state = (rows, self.selected, self.list.size)
        if state != self._drawn:
            self._drawn = state
            self.list.show(stage_list.picture(rows, self.selected, self.list.size[0], self._em))
            changed = True
        row = self._workspace.row(self.selected)
        if self.detail.text != row.detail:
            self.detail.text = row.detail
            changed = layout = True
        for widget, shown in ((self.detail, bool(row.detail)), (self.error, bool(self.error.text))):
            if widget.visible != shown:
                widget.visible = shown
                changed = layout = True
        for stage, panel in self.settings.items():
            shown = stage == self.selected and self._workspace.config is not None
            if panel.widget.visible != shown:
                panel.widget.visible = shown
                changed = layout = True
        config = self._workspace.config
        if self.settings[self.selected].refilter():
            self._shown_config = None
            changed = layout = True
        if config is not None and config is not self._shown_config:
            self._shown_config = config
            for panel in self.settings.values():
                panel.show(config)
            changed = True
        if self._update_buttons(row.state):
            changed = layout = True  # another text needs another width
        return changed, layout

    def _update_buttons(self, state: str) -> bool:
        changed = False
        busy = self._workspace.busy
        there = self._workspace.take is not None
        text = "Check" if self.selected == "capture" else "Run again" if state == "done" else "Run"
        if self.buttons["run"].text != text:
            self.buttons["run"].text = text
            changed = True
        text = "Resume" if self._workspace.paused else "Pause"
        if self.buttons["pause"].text != text:
            self.buttons["pause"].text = text
            self.buttons["pause"].tooltip = _PAUSE[text]
            changed = True
        stoppable = busy and not self._workspace.cancelling
        for key, enabled in {"run": there, "all": there, "pause": stoppable, "cancel": stoppable}.items():
            button, shown = self.buttons[key], busy == (key in ("pause", "cancel"))
            if (button.enabled, button.visible) != (enabled, shown):
                button.enabled, button.visible = enabled, shown
                changed = True
        return changed
