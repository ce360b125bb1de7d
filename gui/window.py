"""The main window: menu, viewport, timeline, controls and a line of figures."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, TextIO

from open3d.visualization import gui, rendering

from gui.panels.controls import ControlsPanel
from gui.panels.timeline import TimelinePanel
from gui.presenters.player import PlayerPresenter
from gui.redraw import Redraws
from gui.viewport import EMPTY, Viewport

SHORTCUTS = """Space: play or pause
Left, Right: one frame back or on
Home, End: first or last frame
[ and ]: previous or next group
2, 3: trained or decoded
L: loop      B: background      R: reset view
Left drag: turn      Right drag or Shift + left drag: move
Wheel: nearer or farther"""

GROUND = (45 / 255, 45 / 255, 45 / 255)
"""Colour between the widgets: that of Open3D's own panels, sRGB."""

_MENU_OPEN, _MENU_QUIT, _MENU_RESET, _MENU_BACKGROUND, _MENU_SHORTCUTS = range(1, 6)


class MainWindow:
    """Puts the panels together and passes events on. All state is the presenters'.

    Args:
        size: of the window's content, pixels.
        log: file to which a JSON line is appended whenever what is shown has changed; None for none.
    """

    def __init__(self, size: tuple[int, int], log: Path | None = None) -> None:
        self.player = PlayerPresenter()
        self._redraws = Redraws()
        self._log: TextIO | None = log.open("a", encoding="utf-8") if log else None
        self._logged: dict[str, Any] = {}
        self._pictures = 0
        application = gui.Application.instance
        self._menu(application)
        self.window = application.create_window("V3 Studio", *size)
        # Without a scene that lives as long as the window, Open3D 0.20 leaks about 2 MB for each drawn frame.
        self._keep_alive = rendering.Open3DScene(self.window.renderer)
        em = self.window.theme.font_size
        self._viewport = Viewport(self.player, self._redraws.changed)
        self._timeline = TimelinePanel(self.player, self._redraws.changed)
        self._controls = ControlsPanel(self.player, em, self._redraws.changed)
        self._message = gui.Label("")
        self._message.background_color = gui.Color(*(value / 255 for value in EMPTY))
        self._status = gui.Label("")
        self._status.text_color = gui.Color(0.62, 0.66, 0.7)
        self._ground = gui.Vert()  # lies under all others: without it what they leave free stays black
        for widget in (
            self._ground,
            self._viewport.widget,
            self._timeline.widget,
            self._controls.widget,
            self._status,
            self._message,
        ):
            self.window.add_child(widget)
        self._ground.background_color = gui.Color(*GROUND)
        self.window.set_on_layout(self._on_layout)
        self.window.set_on_tick_event(self._on_tick)
        self.window.set_on_key(self._on_key)
        self.window.set_on_close(lambda: True)
        for item in (_MENU_OPEN, _MENU_QUIT, _MENU_RESET, _MENU_BACKGROUND, _MENU_SHORTCUTS):
            self.window.set_on_menu_item_activated(item, partial(self._on_menu, item))

    # Opening and closing

    def open(self, path: str) -> None:
        """Open a take or a stream; bad input becomes a sentence in the window."""
        if self.player.open(path):
            self.player.transport.play()
        self.window.title = self.player.title
        self.window.set_needs_layout()
        self._redraws.changed()

    def close(self) -> None:
        """Ask the window to close; it does at the next tick."""
        self.window.close()

    def closed(self) -> None:
        """After the last tick: end threads, close files."""
        self.player.close()
        if self._log is not None:
            self._log.close()

    def _ask_for_folder(self) -> None:
        dialog = gui.FileDialog(gui.FileDialog.OPEN_DIR, "Open a take or a stream", self.window.theme)

        def done(path: str) -> None:
            self.window.close_dialog()
            self.open(path)

        dialog.set_on_cancel(self.window.close_dialog)
        dialog.set_on_done(done)
        self.window.show_dialog(dialog)

    # Menu and keys

    @staticmethod
    def _menu(application: gui.Application) -> None:
        if application.menubar is not None:
            return
        bar, file, view, help_ = gui.Menu(), gui.Menu(), gui.Menu(), gui.Menu()
        file.add_item("Open take or stream...", _MENU_OPEN)
        file.add_separator()
        file.add_item("Quit", _MENU_QUIT)
        view.add_item("Reset view (R)", _MENU_RESET)
        view.add_item("Next background (B)", _MENU_BACKGROUND)
        help_.add_item("Shortcuts (?)", _MENU_SHORTCUTS)
        bar.add_menu("File", file)
        bar.add_menu("View", view)
        bar.add_menu("Help", help_)
        application.menubar = bar

    def _on_menu(self, item: int) -> None:
        actions: dict[int, Callable[[], object]] = {
            _MENU_OPEN: self._ask_for_folder,
            _MENU_QUIT: self.close,
            _MENU_RESET: self.player.reset_view,
            _MENU_BACKGROUND: self.player.next_background,
            _MENU_SHORTCUTS: lambda: self.window.show_message_box("Shortcuts", SHORTCUTS),
        }
        actions[item]()
        self._redraws.changed()

    def _on_key(self, event: gui.KeyEvent) -> bool:
        if event.type != gui.KeyEvent.Type.DOWN:
            return False
        transport, key = self.player.transport, gui.KeyName
        actions: dict[Any, Callable[[], object]] = {
            key.SPACE: transport.toggle,
            key.LEFT: lambda: transport.step(-1),
            key.RIGHT: lambda: transport.step(1),
            key.HOME: lambda: transport.seek(0),
            key.END: lambda: transport.seek(transport.last),
            key.LEFT_BRACKET: lambda: transport.jump_group(-1),
            key.RIGHT_BRACKET: lambda: transport.jump_group(1),
            key.TWO: lambda: self.player.choose_source("trained"),
            key.THREE: lambda: self.player.choose_source("decoded"),
            key.L: lambda: transport.set_loop(not transport.loop),
            key.B: self.player.next_background,
            key.R: self.player.reset_view,
        }
        if event.key not in actions:
            return False
        actions[event.key]()
        self._redraws.changed()
        return True

    # Each tick

    def _on_tick(self) -> bool:
        picture = self.player.poll()
        changed = False
        if picture is not None:
            self._viewport.show(picture)
            self._pictures += 1
            changed = True
        changed |= self._timeline.update()
        changed |= self._controls.update()
        changed |= self._set_text(self._status, self.player.status)
        changed |= self._set_text(self._message, self.player.message)
        self._message.visible = bool(self.player.message)  # even an empty label keeps the mouse from the viewport
        if changed:
            self._redraws.changed()
        self._write_log()
        return self._redraws.due()

    def _set_text(self, label: gui.Label, text: str) -> bool:
        if label.text == text:
            return False
        label.text = text
        self.window.set_needs_layout()  # a label keeps the width of its first text otherwise
        return True

    def _on_layout(self, context: gui.LayoutContext) -> None:
        area = self.window.content_rect
        self._ground.frame = area
        em = self.window.theme.font_size
        margin = 0.5 * em
        controls_height = 1.8 * em
        status_height = 1.5 * em
        timeline_height = 1.6 * em
        left, width = area.x + margin, area.width - 2 * margin
        bottom = area.y + area.height - margin
        bottom -= status_height
        self._status.frame = gui.Rect(left, bottom, width, status_height)
        bottom -= controls_height + 0.3 * em
        self._controls.widget.frame = gui.Rect(left, bottom, width, controls_height)
        bottom -= timeline_height + 0.3 * em
        self._timeline.place(left, bottom, width, timeline_height)
        view_height = max(bottom - 0.3 * em - area.y, 16)
        self._viewport.place(area.x, area.y, area.width, view_height)
        constraints = gui.Widget.Constraints()
        constraints.width = int(0.8 * width)  # a longer sentence is broken into lines
        wanted = self._message.calc_preferred_size(context, constraints)
        self._message.frame = gui.Rect(
            area.x + (area.width - min(wanted.width, constraints.width)) / 2,
            area.y + (view_height - wanted.height) / 2,
            min(wanted.width, constraints.width),
            wanted.height,
        )

    # For tests and bug reports

    def _state(self) -> dict[str, Any]:
        player = self.player
        widgets = {
            "viewport": self._viewport.widget,
            "timeline": self._timeline.widget,
            **self._controls.buttons,
        }
        return {
            "title": player.title,
            "message": player.message,
            "frame": player.transport.frame,
            "frames": player.transport.frame_count,
            "playing": player.transport.playing,
            "loop": player.transport.loop,
            "source": player.source.name if player.source else None,
            "shown": player.picture.frame if player.picture else None,
            "settled": player.settled,
            "pictures": self._pictures,
            "orbit": [player.orbit.yaw, player.orbit.pitch, player.orbit.distance, *player.orbit.target.tolist()],
            "background": player.background,
            "widgets": {
                name: [widget.frame.x, widget.frame.y, widget.frame.width, widget.frame.height]
                for name, widget in widgets.items()
            },
        }

    def _write_log(self) -> None:
        if self._log is None:
            return
        state = self._state()
        if state != self._logged:
            self._logged = state
            self._log.write(json.dumps({"time": time.time(), **state}) + "\n")
            self._log.flush()
