"""The main window: makes the models, actions and widgets, connects them, and runs them at each tick."""

import time
from functools import partial
from pathlib import Path

from open3d.visualization import gui, rendering

from v3studio.gui.actions import menus
from v3studio.gui.actions.commands import ITEMS, MENUS, Actions
from v3studio.gui.actions.help import apply_fix, show_stage_help
from v3studio.gui.actions.opening import Opening
from v3studio.gui.drawing.icons import FONT
from v3studio.gui.drawing.palette import DIM, TEXT
from v3studio.gui.figures import QualityFigures
from v3studio.gui.models.loop import LOOP
from v3studio.gui.models.worker import close_all
from v3studio.gui.overlays import Overlays
from v3studio.gui.pages.start.panel import StartPanel
from v3studio.gui.platform.fonts import title_font, use_icons
from v3studio.gui.platform.menu_bar import MenuBar
from v3studio.gui.shell import Layout, Shell
from v3studio.gui.state import StateLog
from v3studio.gui.user_input import UserInput
from v3studio.gui.viewport import Viewport
from v3studio.gui.widgets.camera_menu import CameraMenu
from v3studio.gui.widgets.controls import ControlsPanel
from v3studio.gui.widgets.hints import Hints
from v3studio.gui.widgets.inspector import InspectorPanel
from v3studio.gui.widgets.modes import ModesPanel
from v3studio.gui.widgets.notice_bar import NoticeBar
from v3studio.gui.widgets.path_panel import PathPanel
from v3studio.gui.widgets.picture import color, put
from v3studio.gui.widgets.stages import StagesPanel
from v3studio.gui.widgets.swap_guard import SwapGuard
from v3studio.gui.widgets.timeline import TimelinePanel
from v3studio.pipelines.events import as_message

SOFTWARE_PAUSE, LONGER_PAUSE = 1 / 10, 1 / 5
"""Minimum seconds between two draws of the window if the CPU draws it, which takes 90 ms of a core: leaves time to
render frames. The longer one applies while rendering falls behind playback."""

JOB_PAUSE, ATTENTION = 1 / 2, 2.0
"""The same while a job, which needs the CPU more, runs; seconds after the window was touched from which it applies."""

REST = 0.05  # seconds between two looks at everything while nothing happens
LOOK_EVERY = 0.5  # seconds between two looks at the file of the marks, which browsers also change
LEAST_SIZE = (51, 40)  # width and height of the window in em below which controls would be cut off


class MainWindow(Shell):
    """See the module. `ticks`: completed ones, without those at rest; `log`: file to which a JSON line is appended
    whenever the state has changed; None for none."""

    def __init__(self, size: tuple[int, int], log: Path | None, device: str, software: bool) -> None:
        application = gui.Application.instance
        if application.menubar is None:  # the first window
            use_icons(application, FONT)
            menus.build(application, MENUS)
        super().__init__(size, device, title_font(application))
        self._software = software
        self._log = StateLog(log)
        self.ticks = 0
        self._next_look = self._last_input = 0.0
        # Without a scene that lives as long as the window, Open3D 0.20 leaks about 2 MB for each drawn frame.
        self._keep_alive = rendering.Open3DScene(self.window.renderer)
        self.x.set_least_size(*(min(round(a * self.em), b) for a, b in zip(LEAST_SIZE, size, strict=True)))
        self._guard = SwapGuard(lambda: self.input.pointer, self.em)
        self.input.pressed = self.dialogs.pressed
        self.dialogs.last_folder, self.dialogs.remembered = self.preferences.folder, self._remember_folder
        self.actions = Actions(self)
        self.places = Opening(self, self._opening_ended)
        self._build()
        self._user = UserInput(self, self.actions, MenuBar(self.em, menus.boxes(MENUS, self.em)))
        self._quality = QualityFigures(self)
        self.layout.left = self.preferences.panel_width
        self.window.set_on_layout(self.layout.place)
        self.window.set_on_tick_event(self._on_tick)
        self.window.set_on_key(self._user.on_key)
        self.window.set_on_close(self.close_requests.asked)
        for number, item in enumerate(ITEMS.values(), start=1):
            self.window.set_on_menu_item_activated(number, partial(self._user.item_chosen, item))
        self._connect()
        self.apply_preferences()
        self.actions.start.update()

    def _build(self) -> None:
        em, changed = self.em, self.changed
        self.viewport = Viewport(self.views, changed)
        self.timeline = TimelinePanel(self.player, em, changed)
        hints = self.hints = Hints(self.input.active, em)
        self.controls = ControlsPanel(self.player, em, self.views.reset, self.timeline.fit, changed, hints)
        self.modes = ModesPanel(self.views.choices(), em, self._chosen, hints)
        self.stages = StagesPanel(
            self.workspace, em, self.views.select, self.actions.run, changed, self.actions.pick, self._widen,
            partial(show_stage_help, self), self._guard, hints,
        )  # fmt: skip
        self.inspector = InspectorPanel(em, changed, partial(apply_fix, self), self.window.set_needs_layout)
        self.camera_menu = CameraMenu(em, changed)
        self.path_panel = PathPanel(em, self.exports.path, self.actions.path.act, changed)
        self.timeline.moved_key = self.actions.path.move_frame
        start = self.actions.start
        self.start = StartPanel(start.page, em, start.act, changed)
        self.notice_bar = NoticeBar(self.notices, em, self.actions.clipboard, changed)
        self.overlays: Overlays = Overlays(self, self.actions)
        self._pictures = (
            self.viewport.picture, self.timeline.picture, self.stages.list, self.inspector.figures, self.inspector.log,
            self.path_panel.picture, self.start.picture, hints.picture,
        )  # fmt: skip
        self.layout: Layout = Layout(self)
        for widget in (
            *self.layout.fills,
            self.viewport.picture.widget,
            *(row.widget for row in self.modes.rows.values()),
            self.timeline.picture.widget,
            self.controls.widget,
            *self.stages.widgets,
            *self.inspector.widgets,
            self.path_panel.picture.widget,
            self.status,
            self.message,
            hints.picture.widget,
            self.camera_menu.widget,
            self.start.picture.widget,
            self.notice_bar.widget,
            self.dialogs.shade,
        ):
            self.window.add_child(widget)

    def _connect(self) -> None:
        workspace, exports = self.workspace, self.exports
        self.views.selected.connect(self._selected)
        workspace.changed.connect(self.changed)
        workspace.refused.connect(self._run_refused)
        workspace.changed.connect(self._forget_refusals)
        workspace.run_ended.connect(partial(self.notices.show, topic="run"))
        self.player.refused.connect(partial(self.notices.show, topic="view"))
        workspace.new_results.connect(self.player.refresh)
        exports.changed.connect(self.changed)
        exports.finished.connect(self._exported)
        for signal in (self.serving.started, self.serving.failed, self.thumbnails.changed):
            signal.connect(lambda *_: self.changed())
        LOOP.every(LOOK_EVERY, self._look_at_marks)

    def _run_refused(self, why: str) -> None:
        self.notices.show(why, bad=True, topic="busy" if self.workspace.busy else "run")

    def _forget_refusals(self) -> None:
        """What a run in progress forbids is allowed after it; a run that has begun was not refused."""
        self.notices.clear("run" if self.workspace.busy else "busy")

    def _exported(self) -> None:
        exports = self.exports
        if not exports.failed:
            self.notices.clear("export")
        stays = exports.request is not None and exports.request.stays
        self.notices.show(exports.result, exports.failed, exports.written, topic="export", stays=stays)
        self.workspace.note(" ".join(f"{line.rstrip('.')}." for line in exports.result.splitlines()), exports.failed)
        self.changed()

    def _look_at_marks(self) -> None:
        if self.marks.refresh():  # somebody marked a frame in a browser
            self.notices.outcome("marks file", str(self.marks.damage or ""))
            self.changed()

    # Opening and closing

    def open(self, path: str) -> None:
        """Open a take, a stream or a URL; bad input is reported in the window."""
        self.places.open(path)
        self.actions.start.update()

    def _opening_ended(self, opened: bool) -> None:
        if opened:
            self.actions.start.hide()
            self.actions.path.stop()
        else:
            self.actions.start.update()

    def close(self) -> None:
        """Request that the window close at the next tick."""
        self.close_requests.granted = True
        self.window.close()

    def _close_if_asked(self) -> None:
        if not self.close_requests.due():
            return
        if self.workspace.job is None:
            self.wants_close = True
        else:
            self.actions.ask_about_job()
            self.changed()

    def failed(self, error: Exception) -> None:
        """Report what a callback raised; an open dialog stays."""
        message = as_message(error)
        bug = "\nThis is a bug in V3 Studio; the terminal shows the details." if message.code == "program.bug" else ""
        self.notices.show(f"{message}{bug}", bad=True)
        self.changed()

    def closed(self) -> None:
        """After the last tick: end threads, close files. A job keeps running."""
        self.player.close()
        self.serving.stop()
        self.stages.estimates.stop()
        close_all()
        # Open3D keeps references to callbacks and therefore to this object; release large objects.
        self.views.forget()
        self._keep_alive = None
        for one in (self.actions.clipboard, self.input, self.x, self._log):
            one.close()

    # User actions

    def _chosen(self, row: str, key: str) -> None:
        if self._guard.refuses() or row != self.views.row:  # a click that came late
            return
        self.views.choose(key)
        if self.views.row != row:
            self.window.set_needs_layout()
        self.changed()

    # At each tick

    def _on_tick(self) -> bool:
        LOOP.run()
        if self._user.tick():
            self._last_input = time.monotonic()
            self._stay_awake()
        self._close_if_asked()
        if self._rests():
            self._log.tick()
            return False
        pasted = self.actions.clipboard.poll()
        if pasted is not None:
            self.actions.start.pasted(pasted)
        changed = self.actions.path.advance()
        changed |= self.views.fit_transport()
        pixels = self.views.poll(self.viewport.picture.size, self.viewport.render_size, self.em)
        if pixels is not None:
            self.viewport.show(pixels)
            self.pictures += 1
            changed = True
        # decided once: everything that is drawn together is updated together
        pausing = self._redraws.pausing
        if not pausing:  # changes between two draws are invisible
            self.exports.path.numbers = self.player.transport.numbers
            path_frames = self.exports.path.frames if self.path_panel.shown else []
            self.timeline.path_keys = [-1 if frame is None else frame for frame in path_frames]
            self.timeline.busy = self.workspace.busy
            numbers, marks = self.player.transport.numbers, sorted(self.marks.marks.items())
            marked = {at: mark.view for frame, mark in marks if (at := numbers.index(frame)) is not None}
            self.timeline.marks = tuple(marked)
            self.player.places = {at: view.place for at, view in marked.items() if view is not None and view.place}
            self._quality.update()
            self.timeline.look(self.input.pointer, self._user.covered or self.hints.listing)
            changed |= self.timeline.update()
            changed |= self.path_panel.update(self.actions.path.pictures(), self.actions.path.previewing)
            changed |= self._update_panels()
            changed |= self.overlays.update()
            changed |= self.actions.search.update()
            put(self.window, title=self.overlays.title)
        if changed:
            self.changed()
        self._log.write(self)
        transport, settled = self.player.transport, self.views.settled
        if transport.playing or not settled or self.workspace.opening:  # the next image is shown as soon as it is there
            self._stay_awake()
        if self._software:
            self._redraws.pause = LONGER_PAUSE if self.player.behind else SOFTWARE_PAUSE
            unwatched = self.input.active and time.monotonic() > self._last_input + ATTENTION
            if self.workspace.busy and not transport.playing and unwatched:
                self._redraws.pause = JOB_PAUSE
            if self.dialogs.focusing:
                self._redraws.pause = 0.0
        due = not pausing and self._redraws.due()
        if due:
            picture = self.player.picture if self.views.shows_player else None
            self.numbers = [
                picture.request.frame if picture is not None else None,
                self.inspector.frame,
                self.timeline.frame,
            ]
            self._guard.drawn()
            unsettled = [picture.settle() for picture in self._pictures]
            if any(unsettled):
                self.changed()
            if self.dialogs.tick():
                self.changed()
        self.ticks += 1
        return due

    def _rests(self) -> bool:
        """Whether nothing happens, so that this tick can pass without a look at everything."""
        now = time.monotonic()
        if now < self._next_look and now >= self._awake_until:
            return True
        self._next_look = now + REST
        return False

    def _update_panels(self) -> bool:
        if self.layout.fullscreen or self.start.shown:
            return False
        stage_view = self.views.stage_view
        controls, row = self.controls.update(self.views.edits_take), self.views.row
        modes = self.modes.update(row, self.views.chosen(), self.views.idle, self.input.pointer)
        stages = self.stages.update()
        changed = controls[0] | modes[0] | stages[0]
        if modes[1]:
            self._guard.swapped()
        if controls[1] or modes[1] or stages[1]:
            self.window.set_needs_layout()
        changed |= self.inspector.update(
            self.player, self.evaluation, self.marks, self.workspace, self.views.stage,
            stage_view.blocks if stage_view is not None else (), self._quality.camera,
        )  # fmt: skip
        changed |= self.inspector.update_log(self.workspace)
        if self.hints.update(self.input.pointer, bool(self._user.buttons) or self._user.covered or self.hints.listing):
            self.window.set_needs_layout()
            changed = True
        status = self.player.status if stage_view is None else stage_view.status
        notice = self.notices.line
        words = [notice or status, self.exports.words, self.serving.words]
        self.status.text_color = color(TEXT if notice else DIM)
        if put(self.status, text="   ".join(filter(None, words))):
            self.window.set_needs_layout()  # otherwise a label keeps the width of its first text
            changed = True
        return changed

    def _remember_folder(self, folder: str) -> None:
        self.preferences.folder = folder
        self.preferences.save()

    def _widen(self, x: float, ended: bool) -> None:
        """The edge of the left panel is dragged; the width is kept for next time."""
        self.layout.widen(x)
        if ended:
            self.preferences.panel_width = round(self.layout.left, 2)
            self.preferences.save()
