"""What the window shows, as plain values, for tests and bug reports."""

from __future__ import annotations

import json
import os
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

from v3studio.gui.shell import Shell
from v3studio.pipelines.takes.authored.edits import describe
from v3studio.studio.json_types import JsonObject

if TYPE_CHECKING:
    from open3d.visualization import gui


def state_of(window: Shell) -> JsonObject:
    """A line of `--log-state`. Places are the middle of something, 0 to 1 across and down its widget, by name."""
    player, stages, views = window.player, window.stages, window.views
    transport = player.transport
    widgets = {name: widget for name, widget in _widgets(window).items() if widget.visible or name == "viewport"}
    return {
        "title": window.window.title,
        "message": window.message.text,  # over the view
        "opening": window.workspace.opening,
        "dialog": window.dialogs.name,
        "typing": window.dialogs.typing,  # whether the dialog's text field has the keyboard focus
        "lines": window.dialogs.lines,
        "stage": views.stage,
        "mode": sorted(views.chosen()),  # the pressed buttons above the view
        "edits": describe(views.editor.edits),
        "selected": views.editor.measured.selected if views.edits_take else 0,  # splats
        "fullscreen": window.layout.fullscreen,
        "figures": window.layout.shows_figures,
        "stages": {row.key: [row.state, row.words, row.detail] for row in window.workspace.rows()},
        "busy": window.workspace.busy,
        "upcoming": stages.upcoming,  # the button to press next
        "error": stages.error.text,  # in the left panel
        "frame": transport.frame,
        "number": transport.number(transport.frame),  # of this frame in the footage
        "frames": transport.frame_count,
        "playing": transport.playing,
        "span": transport.span,
        # places of the buttons in the log
        "fixes": window.inspector.view.areas.middles(window.inspector.log.size) if window.layout.shows_figures else {},
        "what": player.what,
        "compare": player.mode,
        "wipe": round(player.wipe, 3),
        "camera": player.camera,
        "alone": views.capture.camera,
        "menu_camera": window.camera_menu.camera,
        "places": _places(window),  # of what shows a camera, and of the ends of the scene's axes; those in front last
        "shown": player.picture.request.frame if player.picture else None,  # frame of the newest image
        "settled": views.settled,
        "pictures": window.pictures,  # number of images shown so far
        "plots": [plot.title for plot in window.timeline.plots],
        "notice": window.notices.text,
        "start": window.start.shown,
        "cards": [[card.name, card.state, card.quality] for card in window.start.page.shown],
        "start_places": window.start.places if window.start.shown else {},
        "focus": window.start.page.focus if window.start.shown else "",
        "numbers": window.numbers,  # the frames that the image, the figures and the timeline show
        "exporting": window.exports.words,
        "serving": window.serving.address,
        "marks": {str(frame): note for frame, note in sorted(window.marks.notes.items())},
        "path": [[round(key.time, 3), key.frame, key.easing] for key in window.exports.path.keys],
        "orbit": [player.orbit.yaw, player.orbit.pitch, player.orbit.distance, *player.orbit.target.tolist()],
        "timeline_left": window.timeline.plots_view.left,  # column where frame 0 begins
        "timeline_width": window.timeline.plots_view.timeline.width,  # columns of all frames
        "zoom": window.timeline.zoom.shown,  # frames in the timeline; None for all
        "widgets": {
            name: [frame.x, frame.y, frame.width, frame.height]
            for name, frame in ((name, widget.frame) for name, widget in widgets.items())
        },
        "texts": {name: widget.text_value for name, widget in widgets.items() if hasattr(widget, "text_value")},
    }


def _places(window: Shell) -> dict[str, list[float]]:
    view, size = window.views.stage_view, window.viewport.picture_size
    cameras, ends = window.player.scene_places
    scene = (*cameras, *ends) if window.views.shows_scene else ()
    found = scene if view is None else view.places
    return {name: [round(float(at), 4) for at in corners.mean(axis=0) / size] for name, corners in found}


def _widgets(window: Shell) -> dict[str, gui.Widget]:
    settings = window.stages.settings[window.stages.selected]
    return {
        "viewport": window.viewport.picture.widget,
        "timeline": window.timeline.picture.widget,
        "stages": window.stages.list.widget,
        "inspector": window.inspector.figures.widget,
        "log": window.inspector.log.widget,
        "path": window.path_panel.picture.widget,
        "status": window.status,
        "hint": window.hints.picture.widget,
        "start page": window.start.picture.widget,
        **{f"notice {key}": button for key, button in window.notice_bar.buttons.items()},
        **window.controls.buttons,
        **window.stages.buttons,
        "error setting": window.stages.link,
        **{f"camera {key}": button for key, button in window.camera_menu.buttons.items()},
        **{key: button for (row, key), button in window.modes.buttons.items() if row == window.views.row},
        **{f"dialog {key}": widget for key, widget in window.dialogs.widgets.items()},
        "settings filter": settings.filter,
        **settings.widgets,
        **{f"setting {name}": editor for name, (_, editor) in settings.editors.items()},
    }


class StateLog:
    """Appends a JSON line to a file whenever the state has changed. FILE.ticks contains the number of ticks so far: a
    program that drives the window waits for a few of them to be sure that an input event has been processed."""

    def __init__(self, path: Path | None) -> None:
        self._file: TextIO | None = None
        self._last: dict[str, Any] = {}
        self._ticks = -1
        if path is not None:
            self._file = path.open("a", encoding="utf-8")
            self._ticks_file = path.with_name(path.name + ".ticks").open("wb", buffering=0)
            self.tick()  # 0: the first state is written before the first tick is counted

    def write(self, window: Shell) -> None:
        """Call at each tick."""
        if self._file is None:
            return
        state = state_of(window)
        if state != self._last:
            self._last = state
            self._file.write(json.dumps({"time": time.time(), **state}) + "\n")
            self._file.flush()
        self.tick()  # after the line, so that after waiting for a tick one reads a state at least as new

    def tick(self) -> None:
        if self._file is not None:
            self._ticks += 1
            os.pwrite(self._ticks_file.fileno(), b"%12d" % self._ticks, 0)

    def close(self) -> None:
        if self._file is not None:
            self._file.close()
            self._ticks_file.close()
