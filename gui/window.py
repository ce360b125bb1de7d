"""The main window: makes the models, actions and panels, connects them, and runs them at each tick."""

from functools import partial
from pathlib import Path

from open3d.visualization import gui, rendering

from v3studio.gui.actions import menus
from v3studio.gui.actions.bakes import BakeActions
from v3studio.gui.actions.cameras import CameraActions
from v3studio.gui.actions.commands import ITEMS, MENUS, Actions
from v3studio.gui.actions.edits import EditActions
from v3studio.gui.actions.help import HelpActions
from v3studio.gui.actions.marks import MarkActions
from v3studio.gui.actions.opening import OpenDialogs, Opening, PasteActions
from v3studio.gui.actions.output import OutputActions
from v3studio.gui.actions.path import PathActions
from v3studio.gui.actions.points import PointActions
from v3studio.gui.actions.preferences import PreferenceActions
from v3studio.gui.actions.queue import QueueActions
from v3studio.gui.actions.reports import Reports
from v3studio.gui.actions.review import ReviewActions
from v3studio.gui.actions.runs import RunActions
from v3studio.gui.actions.search import SearchActions
from v3studio.gui.actions.settings import SettingRequests
from v3studio.gui.actions.shares import ShareActions
from v3studio.gui.actions.start import StartScreen
from v3studio.gui.actions.worst import WorstActions
from v3studio.gui.drawing.icons import FONT
from v3studio.gui.drawing.palette import DIM, GROUND, PANEL, TEXT
from v3studio.gui.figures import QualityFigures, mark_timeline
from v3studio.gui.layout import Layout, Panels
from v3studio.gui.models.loop import LOOP, later
from v3studio.gui.models.marks import Marks
from v3studio.gui.models.notices import Notices
from v3studio.gui.models.playback.player import PlayerPresenter
from v3studio.gui.models.playback.thumbnails import Thumbnails
from v3studio.gui.models.preferences import PICTURE_SIZES, Preferences
from v3studio.gui.models.take.exports import Exports
from v3studio.gui.models.take.serving import Serving
from v3studio.gui.models.take.take_queue import TakeQueue
from v3studio.gui.models.take.workspace import Workspace
from v3studio.gui.models.worker import close_all
from v3studio.gui.overlays import Overlays
from v3studio.gui.pace import Pace
from v3studio.gui.pages.stage_views import StageViews
from v3studio.gui.pages.start.page import StartPage
from v3studio.gui.pages.start.panel import StartPanel
from v3studio.gui.platform.clipboard import Clipboard
from v3studio.gui.platform.closing import CloseRequests
from v3studio.gui.platform.fonts import title_font, use_icons
from v3studio.gui.platform.input_order import InputOrder
from v3studio.gui.platform.menu_bar import MenuBar
from v3studio.gui.platform.presses import Chords
from v3studio.gui.platform.x_window import XDisplay
from v3studio.gui.state import StateLog, output_state, panel_state, playback_state, take_state
from v3studio.gui.user_input import UserInput
from v3studio.gui.viewport import Viewport
from v3studio.gui.widgets.camera_menu import CameraMenu
from v3studio.gui.widgets.controls import ControlsPanel
from v3studio.gui.widgets.dialogs.base import Dialogs
from v3studio.gui.widgets.hints import Hints
from v3studio.gui.widgets.inspector import InspectorPanel
from v3studio.gui.widgets.modes import ModesPanel
from v3studio.gui.widgets.notice_bar import NoticeBar
from v3studio.gui.widgets.path_panel import PathPanel
from v3studio.gui.widgets.picture import color, make_label, put
from v3studio.gui.widgets.raycast import RaycastMesh
from v3studio.gui.widgets.stages import StagesPanel
from v3studio.gui.widgets.swap_guard import SwapGuard
from v3studio.gui.widgets.timeline import TimelinePanel
from v3studio.pipelines.new_take import sample_settings

LEAST_SIZE = (51, 40)  # width and height of the window in em below which controls would be cut off


class MainWindow:
    """The window. `size`: width and height, pixels. `log`: file to which a JSON line is appended whenever the state has
    changed; None for none. `device`: name of the graphics device, which may be the CPU (`software`). `ticks`: number of
    completed ticks, without those at rest. `numbers`: the frames that image, figures and timeline show, as drawn."""

    def __init__(self, size: tuple[int, int], log: Path | None, device: str, software: bool) -> None:
        application = gui.Application.instance
        if application.menubar is None:  # the first window
            use_icons(application, FONT)
            menus.build(application, MENUS)
        titles = title_font(application)
        self.window = gui.Application.instance.create_window("V3 Studio", *size)
        self.em = float(self.window.theme.font_size)
        # Without a scene that lives as long as the window, Open3D 0.20 leaks about 2 MB for each drawn frame.
        self._keep_alive = rendering.Open3DScene(self.window.renderer)
        self.ticks = 0
        self.numbers: list[int | None] = [None, None, None]
        self._make_models()
        self._x = XDisplay()
        self._x.set_least_size(*(min(round(a * self.em), b) for a, b in zip(LEAST_SIZE, size, strict=True)))
        self._input, self._chords, self._clipboard = InputOrder(self._x.window), Chords(), Clipboard()
        self.close_requests = CloseRequests(lambda: self._x.escape_down or self._input.reports.escaping)
        self.dialogs = Dialogs(self.window, titles, self.preferences)
        self._input.pressed = self.dialogs.pressed
        self._pace = Pace(software, self._input, self.player, self.workspace, self.dialogs)
        self.changed = self._pace.changed
        self._make_panels()
        self._make_actions(device)
        self._make_input()
        self._log = StateLog(log, (
            partial(take_state, self.workspace, self.marks, self.views),
            partial(playback_state, self.player, self.views),
            partial(output_state, self.exports, self.serving, self.notices),
            partial(panel_state, self.window, self.panels, self.layout, self.views, self.dialogs),
            lambda: {"numbers": self.numbers},
        ))  # fmt: skip
        self._connect()
        self._apply_preferences()
        self._screen.update()

    def _make_models(self) -> None:
        self.preferences = Preferences.read()
        self.workspace, self.player = Workspace(), PlayerPresenter(read_mesh=RaycastMesh)
        self.views = StageViews(self.workspace, self.player)
        self.exports, self.serving, self.marks = Exports(), Serving(), Marks()
        self.notices, self._thumbnails = Notices(), Thumbnails()

    def _make_panels(self) -> None:
        em, changed, workspace, player = self.em, self.changed, self.workspace, self.player
        self._guard = SwapGuard(lambda: self._input.pointer, em)
        hints = Hints(self._input.active, em)
        page = StartPage(TakeQueue(), sample_settings() is not None)
        timeline = TimelinePanel(player, em, changed)
        stages = StagesPanel(
            workspace, em, self.views.select, lambda stage, again: self.actions.runs.run(stage, again), changed,
            lambda field: self._settings.pick(field), self._widen, lambda: self.actions.help.show_stage(),
            self._guard, hints,
        )  # fmt: skip
        self.panels = Panels(
            viewport=Viewport(self.views, changed),
            timeline=timeline,
            controls=ControlsPanel(player, em, self.views.reset, timeline.fit, changed, hints),
            modes=ModesPanel(self.views.choices(), em, self._chosen, hints),
            stages=stages,
            inspector=InspectorPanel(
                player,
                workspace,
                self.marks,
                em,
                changed,
                lambda fix: self._settings.apply_fix(fix),
                self.window.set_needs_layout,
            ),
            camera_menu=CameraMenu(em, changed),
            path_panel=PathPanel(
                player,
                self.exports.path,
                self._thumbnails,
                em,
                lambda what, row: self.actions.path.act(what, row),
                changed,
            ),
            start=StartPanel(page, em, lambda name: self._screen.act(name), changed),
            notice_bar=NoticeBar(self.notices, em, self._clipboard, changed),
            hints=hints,
            status=make_label("", DIM, PANEL),
            message=make_label("", TEXT, GROUND),
        )
        self.panels.message.visible = False
        self.layout = Layout(self.window, em, self.panels, self.dialogs, self.views)
        self.layout.left = self.preferences.panel_width
        self._quality = QualityFigures(player, workspace, self.views, timeline)
        self._overlays = Overlays(self.panels, self.layout, workspace, self.views, self.notices, em)
        for widget in (*self.layout.fills, *self.panels.widgets, self.dialogs.shade):
            self.window.add_child(widget)

    def _make_actions(self, device: str) -> None:
        player, workspace, views, exports = self.player, self.workspace, self.views, self.exports
        dialogs, notices, preferences, panels = self.dialogs, self.notices, self.preferences, self.panels
        thumbnails, quality, changed = self._thumbnails, self._quality, self.changed
        self._opening = Opening(player, workspace, views, preferences, notices)
        self._settings = SettingRequests(workspace, panels.stages, self.views, dialogs, notices)
        self._screen = StartScreen(
            panels.start, self.layout, player, workspace, preferences, notices, self.open,
            lambda key: self.actions.act(ITEMS[key]), changed,
        )  # fmt: skip
        opening = OpenDialogs(player, preferences, dialogs, self.open, changed)
        outputs = OutputActions(player, workspace, views, exports, dialogs, notices)
        cameras = CameraActions(
            player, workspace, views, quality, panels.viewport, panels.camera_menu, dialogs, notices,
            self.window.set_needs_layout,
        )  # fmt: skip
        bakes = BakeActions(player, workspace, views, dialogs, notices, changed)
        wanted = {"cameras": cameras.ask, "bakes": bakes.show}
        views.dialog_wanted.connect(later(lambda name: wanted[name]()))
        queue = panels.start.page.queue
        self._pasting = PasteActions(self._clipboard, notices, self.open, opening.new_take, self._chords)
        self._input.reports.kept = self._pasting.kept
        self.actions = Actions(
            player=player,
            views=views,
            workspace=workspace,
            exports=exports,
            serving=self.serving,
            closing=self.close_requests,
            opening=opening,
            preferences=PreferenceActions(preferences, dialogs, notices, self._apply_preferences),
            outputs=outputs,
            runs=RunActions(workspace, views, exports, dialogs, self.close_requests),
            edits=EditActions(player, workspace, views, dialogs, notices, changed),
            review=ReviewActions(player, views, notices, self._guard),
            worst=WorstActions(player, quality, thumbnails, dialogs, cameras.look_through),
            queue=QueueActions(queue, workspace, dialogs, self.open),
            screen=self._screen,
            layout=self.layout,
            marks=MarkActions(player, self.marks, workspace, dialogs, notices),
            points=PointActions(workspace, views, dialogs),
            path=PathActions(
                player, views, exports.path, self.layout, dialogs, notices, lambda: outputs.export("camera-path")
            ),
            shares=ShareActions(player, workspace, exports, self.serving, dialogs, notices),
            help=HelpActions(views, self._settings, dialogs, notices, device),
            search=SearchActions(
                dialogs, self._chords, MENUS, lambda item: self.actions.act(item),
                lambda item: self.actions.why_not(item), changed,
            ),
            notices=notices,
        )  # fmt: skip
        queue.watched = lambda: self._screen.shown or self.actions.queue.shown
        panels.timeline.moved_key = self.actions.path.move_frame

    def _make_input(self) -> None:
        panels, views, dialogs, actions = self.panels, self.views, self.dialogs, self.actions
        bar = MenuBar(self.em, menus.boxes(MENUS, self.em), lambda: self.window.content_rect.y)
        escapes = (
            self.notices.dismiss,
            lambda: self._screen.shown and self._screen.hide(),
            panels.camera_menu.close,
            self.layout.close_log,
            views.leave_camera,
            views.leave,
            lambda: self.player.transport.clear_span(),
            lambda: self.layout.set_fullscreen(False),
        )
        self._user = UserInput(
            self._input, self._chords, dialogs, self.close_requests, bar, panels, actions, self._pasting,
            escapes, lambda: self._x.buttons, self.changed,
        )  # fmt: skip
        self.window.set_on_layout(self.layout.place)
        self.window.set_on_tick_event(self.tick)
        self.window.set_on_key(self._user.on_key)
        self.window.set_on_close(self.close_requests.asked)
        for number, item in enumerate(ITEMS.values(), start=1):
            self.window.set_on_menu_item_activated(number, partial(self._user.item_chosen, item))

    def _connect(self) -> None:
        workspace, exports = self.workspace, self.exports
        reports = self.reports = Reports(workspace, exports, self.marks, self.notices, self.changed)
        self.views.selected.connect(self._selected)
        self.views.clicked.connect(self.panels.camera_menu.close)
        self.views.capture.garbage.outcome.connect(partial(self.notices.outcome, "garbage"))
        self.player.refused.connect(partial(self.notices.show, topic="view"))
        workspace.new_results.connect(self.player.refresh)
        opened = self._opening.opened
        opened.connect(lambda take: exports.path.open(None if take is None else take.camera_path, workspace.history))
        opened.connect(lambda take: self.marks.open(None if take is None else take.marks))
        opened.connect(lambda _: reports.tell_damage())
        opened.connect(lambda _: self.actions.path.preview.stop())
        opened.connect(lambda _: self._screen.hide())
        self._opening.refused.connect(self._screen.update)
        for signal in (workspace.changed, exports.changed, self.serving.started, self._thumbnails.changed):
            signal.connect(self.changed)
        self.serving.failed.connect(lambda _: self.changed())

    def _selected(self, stage: str) -> None:
        self.panels.stages.selected = stage
        self.panels.camera_menu.close()
        self.window.set_needs_layout()

    def _chosen(self, row: str, key: str) -> None:
        self.actions.review.press(row, key)
        self.changed()

    def _apply_preferences(self) -> None:
        self.panels.viewport.most_pixels = PICTURE_SIZES[self.preferences.picture_size]
        self.player.background = self.preferences.background

    def _widen(self, x: float, ended: bool) -> None:
        """The edge of the left panel is dragged to a column; the width is kept for next time."""
        self.layout.widen(x)
        if ended:
            self.preferences.keep(panel_width=round(self.layout.left, 2))

    # For the program that runs the window

    def open(self, path: str) -> None:
        """Open a take, a stream or a URL; bad input is reported in the window."""
        self._opening.open(path)
        self._screen.update()

    def close(self) -> None:
        """Request that the window close at the next tick."""
        self.close_requests.granted = True
        self.window.close()

    def closed(self) -> None:
        """End threads and close files, after the last tick. A job keeps running."""
        self.player.close()
        self.serving.stop()
        self.panels.stages.estimates.stop()
        close_all()
        # Open3D keeps references to callbacks and therefore to this object; release large objects.
        self.views.forget()
        self._keep_alive = None
        for resource in (self._clipboard, self._input, self._x, self._log):
            resource.close()

    # At each tick

    def tick(self) -> bool:
        """Look at everything unless nothing happens; returns whether the window is to be drawn."""
        LOOP.run()
        if self._user.tick():
            self._pace.touched()
        if self.actions.runs.close_if_asked() or self._pasting.waits:
            self.changed()
        if self._pace.rests():
            self._log.tick()
            return False
        self._pasting.poll()
        viewport = self.panels.viewport
        changed = self.actions.path.preview.advance() | self.views.fit_transport()
        pixels = self.views.poll(viewport.picture.size, viewport.render_size, self.em)
        if pixels is not None:
            viewport.show(pixels)
            changed = True
        pausing = self._pace.pausing
        if not pausing:
            changed |= self._update()
        if changed:
            self.changed()
        self._log.write()
        due = self._pace.due(self.views.settled, pausing)
        if due:
            self._drawn()
        self.ticks += 1
        return due

    def _update(self) -> bool:
        """Show the state in the panels; returns whether anything changed."""
        panels, pointer, covered = self.panels, self._input.pointer, self._user.covered
        timeline = panels.timeline
        mark_timeline(timeline, self.player, self.marks, self.exports.path, panels.path_panel.shown)
        timeline.busy = self.workspace.busy
        self._quality.update()
        timeline.look(pointer, covered)
        changed, layout = timeline.update(), False
        changed |= panels.path_panel.update(self.actions.path.preview.playing)
        if not self.layout.fullscreen and not panels.start.shown:
            buttons, layout = self._update_panels(pointer)
            changed |= buttons
            layout |= panels.hints.update(pointer, bool(self._user.buttons) or covered)
        overlays = self._overlays.update()
        if layout or overlays[1]:
            self.window.set_needs_layout()
        put(self.window, title=self._overlays.title)
        return changed | layout | overlays[0] | self.actions.search.update()

    def _update_panels(self, pointer: tuple[int, int] | None) -> tuple[bool, bool]:
        """Show the state in the panels beside the view; whether anything changed, and whether a layout is due."""
        panels, views, quality, notice = self.panels, self.views, self._quality, self.notices.line
        controls = panels.controls.update(views.edits_take)
        modes = panels.modes.update(views.row, views.chosen(), views.idle, pointer)
        stages = panels.stages.update()
        if modes[1]:
            self._guard.swapped()
        blocks = views.stage_view.blocks if views.stage_view is not None else ()
        changed = panels.inspector.update(views.stage, blocks, quality.evaluation, quality.camera)
        words = (notice or views.on_screen.status, self.exports.words, self.serving.words)
        panels.status.text_color = color(TEXT if notice else DIM)
        status = put(panels.status, text="   ".join(filter(None, words)))
        return changed | controls[0] | modes[0] | stages[0], status | controls[1] | modes[1] | stages[1]

    def _drawn(self) -> None:
        """The window is drawn with what it shows now."""
        picture = self.player.picture if self.views.shows_player else None
        shown = picture.request.frame if picture is not None else None
        self.numbers = [shown, self.panels.inspector.frame, self.panels.timeline.frame]
        self._guard.drawn()
        unsettled = [panel.settle() for panel in self.panels.pictures]
        if any(unsettled) | self.dialogs.tick() | self._screen.drawn():
            self.changed()
