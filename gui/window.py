"""The main window: connects panels and presenters and forwards events. All state is in the presenters."""

from __future__ import annotations

import threading
import time
from functools import partial
from pathlib import Path

from open3d.visualization import gui, rendering

from gui.actions import menus
from gui.actions.commands import Actions
from gui.drawing.icons import FONT
from gui.drawing.palette import DIM, GROUND, PANEL, TEXT
from gui.layout import Layout, Panels
from gui.models.evaluation import Evaluation, EvaluationFile
from gui.models.loop import LOOP
from gui.models.marks import Marks
from gui.models.notices import Notices
from gui.models.playback.loading import load
from gui.models.playback.player import PlayerPresenter
from gui.models.playback.rate import Rate
from gui.models.playback.sources import Opened
from gui.models.playback.timeline_plots import Waveform, plots_of
from gui.models.preferences import PICTURE_SIZES, Preferences
from gui.models.take.exports import Exports
from gui.models.take.serving import Serving
from gui.models.take.workspace import Workspace
from gui.models.worker import Done, LatestWorker
from gui.overlays import Overlays
from gui.pages.stage_views import StageViews
from gui.pages.start.panel import StartPanel
from gui.platform.closing import CloseRequests
from gui.platform.drawn_frames import DrawnFrames
from gui.platform.fonts import title_font, use_icons
from gui.platform.input_order import InputOrder
from gui.platform.memory import give_back
from gui.platform.menu_bar import MenuBar
from gui.platform.presses import Chords
from gui.platform.redraw import Redraws
from gui.platform.x_window import XDisplay
from gui.shell import Page
from gui.state import StateLog
from gui.widgets.camera_menu import CameraMenu
from gui.widgets.controls import ControlsPanel
from gui.widgets.dialogs.base import Dialogs
from gui.widgets.hints import Hints
from gui.widgets.inspector import InspectorPanel
from gui.widgets.modes import ModesPanel
from gui.widgets.notice_bar import NoticeActions, NoticeBar
from gui.widgets.path_panel import PathPanel
from gui.widgets.picture import color, holds, plain_label
from gui.widgets.raycast import MeshPicture
from gui.widgets.scene_view import SceneView
from gui.widgets.stages import StagesPanel
from gui.widgets.swap_guard import SwapGuard
from gui.widgets.timeline import TimelinePanel
from gui.widgets.tour_bubble import TourBubble
from gui.widgets.viewport import Viewport
from pipelines.events import as_message
from studio.gaussians import Gaussians

SOFTWARE_PAUSE, LONGER_PAUSE = 1 / 10, 1 / 5
"""Minimum seconds between two draws of the window if the CPU draws it, which takes 90 ms of a core: leaves time to
render frames. The longer one applies while rendering falls behind playback."""

JOB_PAUSE, ATTENTION = 1 / 2, 2.0
"""The same while a job runs and nobody has touched the window for some seconds (the second number): the job needs the
CPU more."""

REST, AWAKE = 0.05, 0.5
"""Seconds between two looks at everything while nothing happens; seconds after something has happened, or while a
picture is awaited, in which the window looks at each tick (10 ms)."""

LOOK_EVERY = 0.5
"""Seconds between two looks at the file of the marks, which browsers also change."""

LEAST_SIZE = (51, 40)
"""Width and height of the window in em below which controls would be cut off."""

QUALITY = ("psnr_trained", "psnr_decoded", "bytes", "flicker")
"""What the timeline shows of every frame."""

Loaded = tuple[Opened, Gaussians | None] | str


class MainWindow:
    """See the module.

    Attributes:
        ticks: completed ticks, without those at rest.
        wants_close: asks the tick loop to close the window; Open3D crashes if it is closed within a tick.

    Args:
        size: size of the window's content, pixels.
        log: file to which a JSON line is appended whenever the state has changed; None for none.
        device: name of the Vulkan device, for Help > About.
        software: whether the CPU draws the window.
    """

    def __init__(
        self, size: tuple[int, int], log: Path | None = None, device: str = "", software: bool = False
    ) -> None:
        self.preferences = Preferences.read()
        self.device = device
        self.workspace = Workspace()
        self.player = PlayerPresenter(read_mesh=MeshPicture)
        self.views = StageViews(self.workspace, self.player, MeshPicture)
        self.exports, self.serving = Exports(), Serving()
        self.evaluation, self.marks = Evaluation(), Marks(None)
        self.notices = Notices()
        self.opening = ""
        self._opener: LatestWorker[str, Loaded] = LatestWorker(load, "v3studio open", self._loaded)
        self._evaluation_file = EvaluationFile()
        self._waveform: Waveform | None = None
        self._software = software
        self._redraws = Redraws()
        self._log = StateLog(log)
        self.pictures = 0
        self.numbers: list[int | None] = [None, None, None]
        self._told = False
        self.drawn = Rate()
        self.close_requests = CloseRequests(lambda: self._x.escape_down)
        self.wants_close = False
        self.ticks = 0
        self._awake_until = self._next_look = self._last_input = 0.0
        self._chords = Chords()
        application = gui.Application.instance
        if application.menubar is None:
            use_icons(application, FONT)
        menus.build(application)
        titles = title_font(application)
        self.window = application.create_window("V3 Studio", *size)
        # Without a scene that lives as long as the window, Open3D 0.20 leaks about 2 MB for each drawn frame.
        self._keep_alive = rendering.Open3DScene(self.window.renderer)
        self.em = float(self.window.theme.font_size)
        self._x, self._buttons = XDisplay(), 0
        self._pointer: tuple[int, int] | None = None
        own = self._x.window
        self.input, self.menu_bar = InputOrder(own), MenuBar(self.em, menus.boxes(self.em))
        self._frames = DrawnFrames(own)
        self.input.wanted = self._pointed
        self._x.set_least_size(*(min(round(a * self.em), b) for a, b in zip(LEAST_SIZE, size, strict=True)))
        self._guard = SwapGuard(lambda: self.input.pointer, self.em)
        self.dialogs = Dialogs(self.window, titles)
        self.input.pressed = self.dialogs.pressed
        self.dialogs.last_folder, self.dialogs.remembered = self.preferences.folder, self._remember_folder
        self.actions = Actions(self, software)
        self._build()
        self.layout.left = self.preferences.panel_width
        self.window.set_on_layout(self.layout.place)
        self.window.set_on_tick_event(self._on_tick)
        self.window.set_on_key(self._on_key)
        self.window.set_on_close(self.close_requests.asked)
        menus.connect(self.window, self._item_chosen)
        self._connect()
        self.apply_preferences()
        self.actions.start.update()

    def _build(self) -> None:
        em, changed = self.em, self.changed
        self.viewport = Viewport(lambda: self.views, changed)
        self.scene_view = SceneView(self.window, self.viewport.on_mouse, self.over_view)
        self.timeline = TimelinePanel(self.player, em, changed)
        hints = self.hints = Hints(self.input.active, em)
        hints.bar = self._free_bar
        self.controls = ControlsPanel(self.player, em, self.views.reset, changed, hints)
        self.modes = ModesPanel(self.views.choices(), em, self._chosen, hints)
        self.stages = StagesPanel(
            self.workspace, em, self.select, self.actions.run, changed, self.actions.pick, self._widen,
            self.actions.help.stage, self._guard, hints,
        )  # fmt: skip
        self.inspector = InspectorPanel(em, changed, self.actions.help.apply_fix, self.laid_out)
        self.camera_menu = CameraMenu(em, changed)
        self.path_panel = PathPanel(em, self.exports.path, self.actions.path.act, changed)
        self.timeline.moved_key = self.actions.path.move_frame
        start, told, tour = self.actions.start, self.actions.notices, self.actions.tour
        self.start = StartPanel(start.page, em, start.act, changed)
        buttons = NoticeActions(told.open_folder, told.copy, told.dismiss)
        self.notice_bar = NoticeBar(self.notices, em, buttons, changed)
        self.tour_bubble = TourBubble(tour.tour, em, tour.act)
        self.overlays = Overlays(self, self.actions, changed)
        self.message, self.status = plain_label(TEXT, GROUND), plain_label(DIM, PANEL)
        self.message.visible = False
        self._pictures = (
            self.viewport.picture, self.timeline.picture, self.stages.list, self.inspector.figures, self.inspector.log,
            self.path_panel.picture, self.start.picture, *self.controls.symbols.values(), hints.picture,
        )  # fmt: skip
        self.layout: Layout = Layout(
            Panels(
                self.window, em, self.views, self.viewport, self.scene_view, self.timeline, self.controls, self.modes,
                self.stages, self.inspector, self.path_panel, self.message, self.status, self.camera_menu, self.start,
                self.notice_bar, self.tour_bubble, hints, self.dialogs.shade,
            )
        )  # fmt: skip
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
            self.tour_bubble.widget,
            self.notice_bar.widget,
            self.dialogs.shade,
        ):
            self.window.add_child(widget)

    def _connect(self) -> None:
        workspace, exports = self.workspace, self.exports
        workspace.changed.connect(self.changed)
        workspace.run_ended.connect(partial(self.notices.tell, topic="run"))
        workspace.new_results.connect(self.player.refresh)
        exports.changed.connect(self.changed)
        exports.finished.connect(self._exported)
        for signal in (self.serving.started, self.serving.failed, self.actions.bakes.bakes.changed):
            signal.connect(lambda *_: self.changed())
        self._marks_timer = LOOP.every(LOOK_EVERY, self._look_at_marks)

    def _exported(self) -> None:
        exports = self.exports
        if not exports.failed:
            self.notices.clear("export")
        stays = exports.request is not None and exports.request.stays
        self.notices.tell(exports.result, exports.failed, exports.written, topic="export", stays=stays)
        self.workspace.note(" ".join(exports.result.split()), exports.failed)
        self.changed()

    def _look_at_marks(self) -> None:
        if self.marks.refresh():  # somebody marked a frame in a browser
            self.marks_changed()
            self.changed()

    # Opening and closing

    def open(self, path: str) -> None:
        """Open a take, a stream or a URL; bad input is reported in the window."""
        self.opening = self.workspace.opening = path
        if self.player.opened is None:
            self.player.message = f"Opening {path} ..."
        else:
            self.notices.tell(f"Opening {path} ...", topic="open")
        self._opener.ask(path)
        self.actions.start.update()

    def _loaded(self, done: Done[str, Loaded]) -> None:
        found = done.result
        self.opening = self.workspace.opening = ""
        if found is None or isinstance(found, str):
            self.notices.tell(found or str(done.error), bad=True, topic="open")
            self.actions.tour.failed()
            self.actions.start.update()
            return
        self.notices.clear("open")
        opened, _ = found
        self.player.adopt(*found)
        self.actions.start.opened()
        self.workspace.open(opened.take)
        self.views.forget()
        # what was open before has just been freed; on a thread, because it can take half a second
        threading.Thread(target=give_back, name="v3studio memory", daemon=True).start()
        self.actions.path.stop()
        self.exports.path.open(opened.take.camera_path if opened.take is not None else None, self.workspace.history)
        self.marks = Marks(opened.take.marks if opened.take is not None else None)
        self.marks_changed()
        self.preferences.opened(str(opened.path))
        self.preferences.save()
        self.player.background = self.preferences.background
        self.select("review" if opened.sources else "capture")
        if opened.sources and self.preferences.play_on_opening:
            self.player.transport.play()
        self.actions.tour.opened()
        self.window.set_needs_layout()

    def apply_preferences(self) -> None:
        """Apply the preferences."""
        self.viewport.most_pixels = PICTURE_SIZES[self.preferences.picture_size]
        self.player.background = self.preferences.background

    def close(self) -> None:
        """Request that the window close at the next tick."""
        self.close_requests.granted = True
        self.window.close()

    def ask_close(self) -> None:
        """Close the window; ask first if a job is running."""
        self.close_requests.ask()

    def _close_if_asked(self) -> None:
        if not self.close_requests.due():
            return
        if self.workspace.job is None:
            self.wants_close = True
        else:
            self.actions.ask_about_job()
            self.changed()

    def failed(self, error: Exception) -> None:
        """Tell what a callback raised; an open dialog stays."""
        message = as_message(error)
        bug = "\nThis is a bug in V3 Studio; the terminal shows the details." if message.code == "program.bug" else ""
        self.notices.tell(f"{message}{bug}", bad=True)
        self.changed()

    def closed(self) -> None:
        """After the last tick: end threads, close files. A job keeps running."""
        self.views.close()
        self.serving.stop()
        self.stages.estimates.stop()
        self.actions.queue.close()
        self.actions.start.close()
        self.actions.clipboard.close()
        self.actions.bakes.close()
        self.actions.path.close()
        self.timeline.filmstrip.close()
        self.workspace.close()
        self._opener.close()
        LOOP.stop(self._marks_timer)
        # Open3D keeps references to callbacks and therefore to this object; release large objects.
        self._keep_alive = None
        self.input.close()
        self._frames.close()
        self._x.close()
        self._log.close()

    @property
    def title(self) -> str:
        """Title of the window."""
        return self.overlays.title

    @property
    def control_held(self) -> bool:
        """Whether Ctrl or Shift is held."""
        return self._chords.control or self._chords.shift

    @property
    def start_actions(self) -> Page:
        """The start page, for other actions."""
        return self.actions.start

    # User actions

    def changed(self) -> None:
        """Note that something on screen may have changed."""
        self._redraws.changed()
        self._stay_awake()

    def select(self, stage: str) -> None:
        """Show a stage."""
        self.stages.selected = self.inspector.stage = stage
        self.camera_menu.close()
        self.views.select(stage)
        self.window.set_needs_layout()

    def run(self, stage: str, again: bool) -> None:
        """Run a stage, or check the footage."""
        self.actions.run(stage, again)

    def over_view(self, x: int, y: int) -> bool:
        """Whether a menu or a card lies over the view at a position, window pixels."""
        over = (self.camera_menu.widget, self.notice_bar.widget, self.tour_bubble.widget)
        return any(widget.visible and holds(widget, x, y) for widget in over)

    def _chosen(self, stage: str, key: str) -> None:
        if self._guard.refuses():
            return
        row = self.views.row
        self.views.choose(key)
        if self.views.row != row:
            self.window.set_needs_layout()
        self.changed()

    def _on_key(self, event: gui.KeyEvent) -> bool:
        LOOP.run()  # what is typed is for what a chosen item opens
        modifier = self._chords.note(event)
        if modifier and event.type == gui.KeyEvent.Type.UP:
            self.actions.search.show_expected()
        is_new = event.type != gui.KeyEvent.Type.DOWN or self.input.reports.is_new()
        if event.key == gui.KeyName.ESCAPE:
            self.close_requests.escape()
            if event.type == gui.KeyEvent.Type.DOWN and self.input.escapes.heard(self._chords.again):
                self._escape()
            return True
        if event.key == gui.KeyName.ENTER and (self.dialogs.name or self.dialogs.expected):
            if event.type == gui.KeyEvent.Type.UP:
                self.dialogs.enter()
                self.changed()
            return True
        if not is_new:
            return True
        if self.dialogs.focusing and self._chords.again:
            return True  # the key that opened the dialog, still held
        if self.dialogs.key(event):
            return True
        if modifier:
            return False
        if event.type != gui.KeyEvent.Type.DOWN or self.dialogs.name:
            return False
        if self.overlays.key(event, self._chords.control, self._chords.shift, self._chords.again):
            self.changed()
            return True
        if self._chords.control:
            action = None if self._chords.again else self.actions.for_chord(event, self._chords.shift)
        else:
            action = self.actions.for_key(event, self._chords.again)
        if action is None:
            return False
        action()
        self.changed()
        return True

    def _escape(self) -> None:
        if self.dialogs.name or self.dialogs.expected:
            self.dialogs.escape()
        elif self.menu_bar.opened:
            self.input.click(*self.menu_bar.empty)  # the toolkit's menus know no keys
        elif (
            self.overlays.escape()
            or self.camera_menu.close()
            or self.layout.close_log()
            or self.views.leave_camera()
            or self.views.leave()
            or self.player.transport.clear_span()
        ):
            pass
        elif self.layout.fullscreen:
            self.layout.set_fullscreen(False)
        self.changed()

    # At each tick

    def _on_tick(self) -> bool:
        if self._frames.poll():
            self._redraws.drawn()
        LOOP.run()
        self.input.escapes.dialog = bool(self.dialogs.name)
        came = self.input.poll(hold=self.dialogs.focusing, release=self.dialogs.expected)
        if came - {"move", "key up"}:  # a frame that the toolkit drops would hide what they did
            self.changed()
        elif came:
            self._stay_awake()
        self.input.escapes.dialog = bool(self.dialogs.name)  # what came may have closed it
        if self.input.escapes.kept():  # by a text field, which only restores its text
            self._escape()
        self._close_if_asked()
        self._watch_mouse()
        if self._rests():
            self._log.tick()
            return False
        self._read_evaluation()
        self._show_waveform()
        copied = self.actions.clipboard.poll()
        if copied is not None:
            self.actions.start.copied(copied)
        changed = self.actions.path.advance()
        changed |= self.actions.scene.follow()
        changed |= self.views.fit_transport()
        pixels = self.views.poll(self.viewport.size, self.viewport.drawn_size, self.em)
        if pixels is not None:
            self.viewport.show(pixels)
            self.pictures += 1
            changed = True
        # decided once: everything that is drawn together is updated together
        pausing = self._redraws.pausing
        if not pausing:  # changes between two draws are invisible
            self.timeline.path_keys = [key.frame for key in self.exports.path.keys] if self.path_panel.shown else []
            self.timeline.busy = self.workspace.busy
            self.timeline.look(self.input.pointer, self._covered)
            changed |= self.timeline.update()
            changed |= self.path_panel.update(self.actions.path.pictures(), self.actions.path.previewing)
            changed |= self._update_panels()
            changed |= self.overlays.update()
            changed |= self.actions.search.update()
        if self.window.title != self.title:
            self.window.title = self.title
        message = self.workspace.message or self.views.message
        changed |= self._set_text(self.message, message)
        self.message.visible = bool(message) and not self.start.shown  # even an empty label blocks the mouse
        if changed:
            self.changed()
        self._log.write(self)
        transport, settled = self.player.transport, self.views.settled
        if transport.playing or not settled or self.opening:  # the next picture is shown as soon as it is there
            self._stay_awake()
        if came:
            self._last_input = time.monotonic()
        if self._software:
            self._redraws.pause = LONGER_PAUSE if self.player.behind else SOFTWARE_PAUSE
            unwatched = self.input.active and time.monotonic() > self._last_input + ATTENTION
            if self.workspace.busy and not transport.playing and unwatched:
                self._redraws.pause = JOB_PAUSE
            if self.dialogs.focusing:
                self._redraws.pause = 0.0
        due = not pausing and self._redraws.due()
        if due:
            self.actions.scene.draw()
            shown = self.player.picture.frame if self.player.picture is not None and self.views.shows_player else None
            self.numbers = [shown, self.inspector.frame, self.timeline.frame]
            self.drawn.hit()
            self._guard.drawn()
            unsettled = [picture.settle() for picture in self._pictures]
            if any(unsettled):
                self.changed()
            if self.dialogs.tick():
                self.changed()
        self.ticks += 1
        return due

    def _stay_awake(self) -> None:
        self._awake_until = time.monotonic() + AWAKE

    def _rests(self) -> bool:
        """Whether nothing happens, so that this tick can pass without a look at everything."""
        now = time.monotonic()
        if now < self._next_look and now >= self._awake_until:
            return True
        self._next_look = now + REST
        return False

    def _item_chosen(self, key: str) -> None:
        """An item of a menu was chosen, which closes the menu. It acts before the next tick or key: the toolkit reports
        it while it draws, and a dialog that opens then would come below its shade, which the next frame has first.
        """
        self.menu_bar.closed()
        LOOP.post(self.actions.menu()[key])
        self.changed()

    def _watch_mouse(self) -> None:
        """Draw when a mouse button is pressed or released: the toolkit tells of no clicks on its menus and lists, and
        would draw what they open only when the pointer moves."""
        buttons = self.input.buttons if self.input.active else self._x.buttons
        if buttons != self._buttons:
            self._buttons = buttons
            self.changed()
        pointer, before, self._pointer = self.input.pointer, self._pointer, self.input.pointer
        if pointer != before:
            self.actions.edits.moved()
        if pointer not in (None, before) and holds(self.stages.settings[self.stages.selected].widget, *pointer):
            self.changed()  # a tooltip has the size of the one before it until the second draw

    def _pointed(self, kind: str, button: int, x: int, y: int) -> bool:
        """Whether the toolkit is to see that the pointer is moved or a button is pressed at a position."""
        self.menu_bar.height = self.window.content_rect.y
        if self.dialogs.name:
            self.menu_bar.closed()
            return kind != "press" or not self.actions.search.press(button, x, y)
        if kind == "press" and button == 1:
            settings = self.stages.settings[self.stages.selected]
            self.hints.press(x, y, (*self.controls.lists, *settings.lists))
            settings.press(x, y)
        if kind == "move":
            self.menu_bar.move(x, y)
        return kind == "move" or button != 1 or self.menu_bar.press(x, y)

    @property
    def _covered(self) -> bool:
        """Whether a dialog or a menu is open, as far as can be told."""
        return bool(self.dialogs.name or self.camera_menu.camera or self.menu_bar.opened)

    def _free_bar(self) -> tuple[int, int, int, int]:
        """Left, top, width and height of the menu bar without its titles, pixels; no height while it is hidden."""
        area, left = self.window.content_rect, self.menu_bar.empty[0]
        return left, 0, area.x + area.width - left, area.y

    def _update_panels(self) -> bool:
        if self.layout.fullscreen or self.start.shown:
            return False
        stage_view = self.views.stage_view
        changed, layout = self.controls.update()
        if layout:
            self.window.set_needs_layout()
        row, chosen, idle = self.views.row, self.views.chosen(), self.views.idle
        touched, layout = self.modes.update(row, chosen, idle, self.input.pointer)
        changed |= touched
        if layout:
            self._guard.swapped()
            self.window.set_needs_layout()
        touched, layout = self.stages.update()
        changed |= touched
        if layout:
            self.window.set_needs_layout()
        # at rest, a figure that changes with each draw would ask for the next one
        drawn = self.drawn.value if self.player.transport.playing else 0.0
        changed |= self.inspector.update(
            self.player, self.evaluation, self.marks, self.workspace, self.views.stage,
            stage_view.blocks if stage_view is not None else (), drawn, self._camera,
        )  # fmt: skip
        changed |= self.inspector.update_log(self.workspace)
        if self.hints.update(self.input.pointer, bool(self._buttons) or self._covered or self.hints.listing):
            self.window.set_needs_layout()
            changed = True
        status = self.player.status if stage_view is None else stage_view.status
        told = self.overlays.line
        words = [told or status, self.scene_view.words, self.exports.words, self.serving.words]
        if self._told != bool(told):
            self._told = bool(told)
            self.status.text_color = color(TEXT if told else DIM)
        return changed | self._set_text(self.status, "   ".join(filter(None, words)))

    @property
    def _camera(self) -> str:
        """The camera whose figures are shown; "" for the mean, as over an edit, which has a view of its own."""
        return self.player.camera if self.views.shows_player else ""

    def _read_evaluation(self) -> None:
        take, frames = self.workspace.take, self.player.transport.frame_count
        camera, other = self._camera, self.player.other
        if not self._evaluation_file.changed(take, frames, camera, other):
            return
        self.evaluation = Evaluation.read(take.evaluation) if take is not None else Evaluation()
        others = {name: other.series(name, camera) for name in QUALITY} if other is not None else None
        camera = camera if camera in self.evaluation.cameras else ""
        series = {name: self.evaluation.series(name, frames, camera) for name in QUALITY}
        self.timeline.plots = plots_of(
            series, self.evaluation.whose(camera), others, self.evaluation.whose_briefly(camera)
        )
        self._waveform = None
        against = f"\nYellow, and in parentheses: {other.label}." if other is not None else ""
        self.timeline.explanation = self.evaluation.explanation + against

    def _show_waveform(self) -> None:
        """Add the sound's row to the timeline once its waveform is known, or remove it."""
        waveform = self.player.audio.waveform if self.player.audio is not None else None
        if waveform is not self._waveform:
            plots = [plot for plot in self.timeline.plots if not isinstance(plot, Waveform)]
            self.timeline.plots = (*plots, *((waveform,) if waveform is not None else ()))
            self._waveform = waveform

    def marks_changed(self) -> None:
        """Update the timeline's marks."""
        self.timeline.marks = tuple(sorted(self.marks.notes))

    def _remember_folder(self, folder: str) -> None:
        self.preferences.folder = folder
        self.preferences.save()

    def _widen(self, x: float, ended: bool) -> None:
        """The edge of the left panel is dragged; the width is kept for next time."""
        self.layout.widen(x)
        if ended:
            self.preferences.panel_width = round(self.layout.left, 2)
            self.preferences.save()

    def laid_out(self) -> None:
        """Lay the window out again before it is next drawn."""
        self.window.set_needs_layout()

    def _set_text(self, label: gui.Label, text: str) -> bool:
        if label.text == text:
            return False
        label.text = text
        self.window.set_needs_layout()  # otherwise a label keeps the width of its first text
        return True
