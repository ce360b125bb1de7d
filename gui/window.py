"""The main window: puts panels, views and presenters together and passes events on. All state is the presenters'."""

from __future__ import annotations

import json
import time
from collections import deque
from pathlib import Path
from typing import Any, TextIO

from open3d.visualization import gui, rendering

from gui import menus
from gui.actions import Actions
from gui.panels.controls import ControlsPanel
from gui.panels.dialogs import Dialogs
from gui.panels.inspector import InspectorPanel
from gui.panels.modes import ModesPanel
from gui.panels.picture import colour
from gui.panels.stages import StagesPanel
from gui.panels.timeline import TimelinePanel
from gui.presenters.evaluation import Evaluation
from gui.presenters.exports import Exports
from gui.presenters.marks import Marks
from gui.presenters.palette import DIM, GROUND, PANEL, TEXT
from gui.presenters.player import PlayerPresenter, load
from gui.presenters.preferences import Preferences
from gui.presenters.sources import Opened
from gui.presenters.strips import strips_of
from gui.presenters.views import Views
from gui.presenters.worker import LatestWorker
from gui.presenters.workspace import Workspace
from gui.raycast import MeshPicture
from gui.redraw import Redraws
from gui.viewport import Viewport
from studio.gaussians import Gaussians

CLOSE_WAIT = 0.4
"""Seconds to wait whether a request to close was Escape."""

SOFTWARE_PAUSE, LONGER_PAUSE = 1 / 10, 1 / 5
"""Least seconds between two drawings of the window where the processor draws it, which takes 90 ms of a core: it then
has time for the pictures. The longer one holds while they fall behind the rate at which the stream plays."""

Loaded = tuple[Opened, Gaussians | None] | str


class MainWindow:
    """See the module.

    Attributes:
        wants_close: it shall be closed by whoever runs the ticks; from within a tick Open3D crashes.

    Args:
        size: of the window's content, pixels.
        log: file to which a JSON line is appended whenever what is shown has changed; None for none.
        device: name of the Vulkan device, for Help > About.
        software: whether the processor draws the window.
    """

    def __init__(
        self, size: tuple[int, int], log: Path | None = None, device: str = "", software: bool = False
    ) -> None:
        self.preferences = Preferences.read()
        self.device = device
        self.workspace = Workspace()
        self.player = PlayerPresenter()
        self.views = Views(self.workspace, self.player, MeshPicture)
        self.exports = Exports()
        self.evaluation, self.marks = Evaluation(), Marks(None)
        self.fullscreen = False
        self.opening = ""
        self._opener: LatestWorker[str, Loaded] = LatestWorker(load, "v3studio open")
        self._evaluation_of: object = None
        self._software = software
        self._redraws = Redraws()
        self._log: TextIO | None = log.open("a", encoding="utf-8") if log else None
        self._logged: dict[str, Any] = {}
        self._pictures = 0
        self._drawn_times: deque[float] = deque(maxlen=240)
        self._may_close = False
        self._close_asked: list[float] = []
        self.wants_close = False
        application = gui.Application.instance
        menus.build(application)
        self.window = application.create_window("V3 Studio", *size)
        # Without a scene that lives as long as the window, Open3D 0.20 leaks about 2 MB for each drawn frame.
        self._keep_alive = rendering.Open3DScene(self.window.renderer)
        self.em = float(self.window.theme.font_size)
        self.dialogs = Dialogs(self.window)
        self.actions = Actions(self)
        self._build()
        self.window.set_on_layout(self._on_layout)
        self.window.set_on_tick_event(self._on_tick)
        self.window.set_on_key(self._on_key)
        self.window.set_on_close(self._on_close)
        menus.connect(self.window, self.actions.menu(), self.changed)
        self.apply_preferences()

    def _build(self) -> None:
        em, changed = self.em, self.changed
        # What the panels leave free. One ground under everything would cost a software driver 30 ms a drawing.
        # Few, because Open3D draws wrongly where a window has more than 20 visible children.
        self._fills = [gui.Vert() for _ in range(4)]
        for number, fill in enumerate(self._fills):
            fill.background_color = colour(GROUND if number < 3 else PANEL)
        self.viewport = Viewport(lambda: self.views, changed)
        self.timeline = TimelinePanel(self.player, em, changed)
        self.controls = ControlsPanel(self.player, em, self.views.reset, changed)
        self.modes = ModesPanel(self.views.choices(), em, self._chosen)
        self.stages = StagesPanel(self.workspace, em, self.select, self.actions.run, changed)
        self.inspector = InspectorPanel(em, changed)
        self._message = gui.Label("")
        self._message.visible = False
        self._message.background_color = colour(GROUND)
        self._message.text_color = colour(TEXT)
        self._status = gui.Label("")
        self._status.text_color = colour(DIM)
        self._status.background_color = colour(PANEL)
        for widget in (
            *self._fills,
            self.viewport.picture.widget,
            *self.modes.rows.values(),
            self.timeline.picture.widget,
            self.controls.widget,
            *self.stages.widgets,
            *self.inspector.widgets,
            self._status,
            self._message,
        ):
            self.window.add_child(widget)

    # Opening and closing

    def open(self, path: str) -> None:
        """Open a take, a stream or an address; bad input becomes a sentence in the window."""
        self.opening = path
        self.player.message = f"Opening {path} ..."
        self._opener.ask(path)
        self.changed()

    def _opened(self, path: str, found: Loaded) -> None:
        self.opening = ""
        if isinstance(found, str):
            self.player.message = found
            return
        opened, _ = found
        self.player.adopt(*found)
        self.workspace.open(opened.take)
        self.marks = Marks(opened.take.marks if opened.take is not None else None)
        self._evaluation_of = None
        self.preferences.opened(str(opened.path))
        self.preferences.save()
        self.player.background = self.preferences.background
        self.select("review" if opened.sources else "capture")
        if opened.sources and self.preferences.play_on_opening:
            self.player.transport.play()
        self.window.title = self.player.title
        self.window.set_needs_layout()

    def apply_preferences(self) -> None:
        """Let the preferences hold."""
        from gui.presenters.preferences import PICTURE_SIZES

        self.viewport.most_pixels = PICTURE_SIZES[self.preferences.picture_size]
        self.player.background = self.preferences.background

    def close(self) -> None:
        """Ask the window to close; it does at the next tick."""
        self._may_close = True
        self.window.close()

    def ask_close(self) -> None:
        """Close, unless a job runs: then ask first."""
        self._close_asked = [time.monotonic() - CLOSE_WAIT]

    def _on_close(self) -> bool:
        # Open3D asks to close at Escape too, when it is pressed and when it is released, before it tells of the key (of
        # which it does not tell while a text is being edited). A request that stays alone is meant.
        self._close_asked.append(time.monotonic())
        return self._may_close

    def _decide_close(self) -> None:
        if not self._close_asked or time.monotonic() < self._close_asked[-1] + CLOSE_WAIT:
            return
        alone = len(self._close_asked) == 1
        self._close_asked.clear()
        if not alone:
            return
        if self.workspace.job is None:
            self.wants_close = True
        else:
            self.actions.ask_about_job()
            self.changed()

    def closed(self) -> None:
        """After the last tick: end threads, close files. A job goes on by itself."""
        self.views.close()
        self.workspace.close()
        self._opener.close()
        # Open3D holds on to callbacks, and so to this object; what is large must go by itself.
        self._keep_alive = None
        if self._log is not None:
            self._log.close()

    # What a user does

    def changed(self) -> None:
        """Something that is shown may have changed."""
        self._redraws.changed()

    def select(self, stage: str) -> None:
        """Show a stage."""
        self.stages.selected = stage
        self.views.select(stage)
        self.window.set_needs_layout()

    def set_fullscreen(self, on: bool) -> None:
        """The viewport alone, or with all panels."""
        self.fullscreen = on
        self.window.show_menu(not on)
        for widget in (*self._fills, self._status, self.controls.widget, self.timeline.picture.widget,
                       *self.inspector.widgets):  # fmt: skip
            widget.visible = not on
        self.stages.set_visible(not on)
        if on:
            for row in self.modes.rows.values():
                row.visible = False
        self.window.set_needs_layout()

    def _chosen(self, stage: str, key: str) -> None:
        self.views.choose(key)
        self.changed()

    def _on_key(self, event: gui.KeyEvent) -> bool:
        if event.key == gui.KeyName.ESCAPE:
            self._close_asked.clear()
            if event.type == gui.KeyEvent.Type.DOWN:
                self._escape()
            return True
        if event.key == gui.KeyName.ENTER and self.dialogs.name:
            if event.type == gui.KeyEvent.Type.UP:
                self.dialogs.enter()
                self.changed()
            return True
        if event.type != gui.KeyEvent.Type.DOWN or self.dialogs.name:
            return False
        action = self.actions.for_key(event)
        if action is None:
            return False
        action()
        self.changed()
        return True

    def _escape(self) -> None:
        if self.dialogs.name:
            self.dialogs.close()
        elif self.fullscreen:
            self.set_fullscreen(False)
        self.changed()

    # Each tick

    def _on_tick(self) -> bool:
        self._decide_close()
        opened = self._opener.take()
        if opened is not None and opened.result is not None:
            self._opened(opened.request, opened.result)
            self.changed()
        changed = self.workspace.poll()
        if self.workspace.take_results():
            changed |= self.player.refresh()
            self._evaluation_of = None
        self._read_evaluation()
        if self.exports.poll():
            changed = True
            if self.exports.result:
                self.dialogs.message("Export", self.exports.result)
                self.exports.result = ""
        changed |= self.views.fit_transport()
        pixels = self.views.poll(self.viewport.size, self.viewport.drawn_size, self.em)
        if pixels is not None:
            self.viewport.show(pixels)
            self._pictures += 1
            changed = True
        if not self._redraws.pausing:  # nobody sees what changes between two drawings
            changed |= self.timeline.update()
            if not self.fullscreen:
                changed |= self._update_panels()
        message = self.workspace.message or self.views.message
        changed |= self._set_text(self._message, message)
        self._message.visible = bool(message)  # even an empty label keeps the mouse from the viewport
        if changed:
            self.changed()
        self._write_log()
        if self._software:
            self._redraws.pause = LONGER_PAUSE if self.player.behind else SOFTWARE_PAUSE
        due = self._redraws.due()
        if due:
            self._drawn_times.append(time.monotonic())
        return due

    def _update_panels(self) -> bool:
        board = self.views.board
        changed = self.controls.update()
        changed |= self.modes.update(self.views.stage, self.views.chosen())
        touched, layout = self.stages.update()
        changed |= touched
        if layout:
            self.window.set_needs_layout()
        changed |= self.inspector.update(
            self.player, self.evaluation, self.marks, self.workspace, self.views.stage, self.drawn_rate
        )
        status = self.player.status if board is None else board.status
        return changed | self._set_text(self._status, "   ".join(filter(None, [status, self.exports.words])))

    @property
    def drawn_rate(self) -> float:
        """How often a second the window was drawn over the last two seconds."""
        horizon = time.monotonic() - 2.0
        recent = [moment for moment in self._drawn_times if moment >= horizon]
        return (len(recent) - 1) / (recent[-1] - recent[0]) if len(recent) > 1 and recent[-1] > recent[0] else 0.0

    def _read_evaluation(self) -> None:
        take = self.workspace.take
        stamp = None
        if take is not None:
            stamp = (take.root, take.evaluation.stat().st_mtime_ns if take.evaluation.is_file() else 0)
        frames = self.player.transport.frame_count
        if (stamp, frames) == self._evaluation_of:
            return
        self._evaluation_of = (stamp, frames)
        self.evaluation = Evaluation.read(take.evaluation) if take is not None else Evaluation()
        names = ("psnr_trained", "psnr_decoded", "bytes")
        self.timeline.strips = strips_of({name: self.evaluation.series(name, frames) for name in names})

    def marks_changed(self) -> None:
        """The timeline shows them."""
        self.timeline.marks = tuple(sorted(self.marks.notes))

    def _set_text(self, label: gui.Label, text: str) -> bool:
        if label.text == text:
            return False
        label.text = text
        self.window.set_needs_layout()  # a label keeps the width of its first text otherwise
        return True

    # Layout

    def _on_layout(self, context: gui.LayoutContext) -> None:
        area, em = self.window.content_rect, self.em
        x, y, width, height = area.x, area.y, area.width, area.height
        if self.fullscreen:
            self.viewport.picture.place(x, y, width, height)
            self._place_message(context, x, y, width, height)
            return
        left, right = min(round(18 * em), width // 3), min(round(17 * em), width // 4)
        bottom_height = round(11.2 * em)
        bottom = y + height - bottom_height
        self.stages.place(x, y, left, height, context)
        gap = round(0.3 * em)
        inner = x + left + gap
        inner_width = width - left - gap
        pad = round(0.5 * em)
        self._status.frame = gui.Rect(inner + pad, y + height - round(1.5 * em), inner_width - 2 * pad, round(1.4 * em))
        self.controls.widget.frame = gui.Rect(
            inner + pad, y + height - round(3.4 * em), inner_width - 2 * pad, round(1.8 * em)
        )
        self.timeline.picture.place(inner + pad, bottom + pad, inner_width - 2 * pad, bottom_height - 3.6 * em - pad)
        view_width = inner_width - right - gap
        row = round(2.0 * em)
        self.modes.place(inner + pad, y + 0.25 * em, view_width - pad, 1.5 * em)
        self.viewport.picture.place(inner, y + row, view_width, bottom - y - row)
        self.inspector.place(inner + view_width + gap, y, right, bottom - y)
        frames = (
            (x + left, y, gap, height),
            (inner, y, view_width, row),
            (inner + view_width, y, gap, bottom - y),
            (inner, bottom, inner_width, bottom_height),
        )
        for fill, frame in zip(self._fills, frames, strict=True):
            fill.frame = gui.Rect(*frame)
        self._place_message(context, inner, y + row, view_width, bottom - y - row)

    def _place_message(self, context: gui.LayoutContext, x: int, y: int, width: int, height: int) -> None:
        limits = gui.Widget.Constraints()
        limits.width = int(0.85 * width)  # a longer sentence is broken into lines
        wanted = self._message.calc_preferred_size(context, limits)
        wide = min(wanted.width, limits.width)
        self._message.frame = gui.Rect(x + (width - wide) // 2, y + (height - wanted.height) // 2, wide, wanted.height)

    # For tests and bug reports

    def state(self) -> dict[str, Any]:
        """All that a test may want to know of what is shown."""
        player, workspace = self.player, self.workspace
        widgets: dict[str, gui.Widget] = {
            "viewport": self.viewport.picture.widget,
            "timeline": self.timeline.picture.widget,
            "stages": self.stages.list.widget,
            **self.controls.buttons,
            **self.stages.buttons,
            **{key: button for (stage, key), button in self.modes.buttons.items() if stage == self.views.stage},
            **{f"dialog {key}": widget for key, widget in self.dialogs.widgets.items()},
        }
        settings = self.stages.settings[self.stages.selected]
        widgets |= {f"setting {name}": editor for name, (_, editor) in settings.editors.items()}
        return {
            "title": player.title,
            "message": self._message.text,
            "opening": self.opening,
            "dialog": self.dialogs.name,
            "stage": self.views.stage,
            "mode": sorted(self.views.chosen()),
            "fullscreen": self.fullscreen,
            "stages": {row.key: [row.state, row.words, row.detail] for row in workspace.rows()},
            "busy": workspace.busy,
            "error": self.stages.error.text,
            "frame": player.transport.frame,
            "frames": player.transport.frame_count,
            "playing": player.transport.playing,
            "loop": player.transport.loop,
            "what": player.what,
            "compare": player.mode,
            "wipe": round(player.wipe, 3),
            "camera": player.camera,
            "shown": player.picture.frame if player.picture else None,
            "settled": self.views.settled,
            "pictures": self._pictures,
            "handed_over": round(player.rate),
            "exporting": self.exports.words,
            "marks": {str(frame): note for frame, note in sorted(self.marks.notes.items())},
            "orbit": [player.orbit.yaw, player.orbit.pitch, player.orbit.distance, *player.orbit.target.tolist()],
            "background": player.background,
            "timeline_left": self.timeline.board.left,
            "widgets": {
                name: [widget.frame.x, widget.frame.y, widget.frame.width, widget.frame.height]
                for name, widget in widgets.items()
                if widget.visible or name == "viewport"
            },
        }

    def _write_log(self) -> None:
        if self._log is None:
            return
        state = self.state()
        if state != self._logged:
            self._logged = state
            self._log.write(json.dumps({"time": time.time(), **state}) + "\n")
            self._log.flush()
