"""The window's state as plain values, for tests and bug reports. Functions return parts of a line of `--log-state`.

Places of what is drawn in an image are the middle of it, 0 to 1 across and down its widget, by name.
"""

import json
import os
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TextIO

from open3d.visualization import gui

from v3studio.gui.layout import Layout, Panels
from v3studio.gui.models.marks import Marks
from v3studio.gui.models.notices import Notices
from v3studio.gui.models.playback.player import PlayerPresenter
from v3studio.gui.models.stage_rows import TITLES
from v3studio.gui.models.take.exports import Exports
from v3studio.gui.models.take.serving import Serving
from v3studio.gui.models.take.workspace import Workspace
from v3studio.gui.pages.stage_views import StageViews
from v3studio.gui.widgets.dialogs.base import Dialogs
from v3studio.pipelines.takes.authored.edits import describe
from v3studio.studio.json_types import JsonObject


def take_state(workspace: Workspace, marks: Marks, views: StageViews) -> JsonObject:
    """The open take: its stages, edits and marks."""
    editor = views.editor
    return {
        "opening": workspace.opening,
        "stages": {row.key: [row.state, row.words, row.detail] for row in workspace.rows()},
        "busy": workspace.busy,
        "edits": describe(editor.edits),
        "selected": editor.measured.selected if views.edits_take else 0,  # splats
        "marks": {str(frame): note for frame, note in sorted(marks.notes.items())},
    }


def playback_state(player: PlayerPresenter, views: StageViews) -> JsonObject:
    """The frame and the view of it."""
    transport, orbit = player.transport, player.orbit
    return {
        "stage": views.stage,
        "mode": sorted(views.chosen()),  # the pressed buttons above the view
        "frame": transport.frame,
        "number": transport.number(transport.frame),  # of this frame in the footage
        "frames": transport.frame_count,
        "playing": transport.playing,
        "span": transport.span,
        "what": player.what,
        "compare": player.mode,
        "wipe": round(player.wipe, 3),
        "camera": player.camera,
        "alone": views.capture.camera,
        "shown": player.picture.request.frame if player.picture else None,  # frame of the newest image
        "settled": views.settled,
        "orbit": [orbit.yaw, orbit.pitch, orbit.distance, *orbit.target.tolist()],
    }


def output_state(exports: Exports, serving: Serving, notices: Notices) -> JsonObject:
    """The export, the server, the notice, and the camera path."""
    return {
        "exporting": exports.words,
        "serving": serving.address,
        "notice": notices.text,
        "path": [[round(key.time, 3), key.frame, key.easing] for key in exports.path.keys],
    }


def panel_state(window: gui.Window, panels: Panels, layout: Layout, views: StageViews, dialogs: Dialogs) -> JsonObject:
    """The places of widgets, and what they show."""
    start, timeline = panels.start, panels.timeline
    widgets = {
        name: widget
        for name, widget in _widgets(panels, views, dialogs).items()
        if widget.visible or name == "viewport"
    }
    return {
        "title": window.title,
        "message": panels.message.text,  # over the view
        "dialog": dialogs.name,
        "typing": dialogs.typing,  # whether its text field has the keyboard focus
        "lines": dialogs.lines,  # of its list
        "fullscreen": layout.fullscreen,
        "figures": layout.shows_figures,
        "upcoming": panels.stages.upcoming,  # the button to press next
        "error": panels.stages.error.text,  # in the left panel
        "menu_camera": panels.camera_menu.camera,
        "parts": _parts(panels, layout, views, dialogs),
        "pictures": panels.viewport.pictures,
        "plots": [plot.title for plot in timeline.plots],
        "start": start.shown,
        "cards": [[card.name, card.words, card.quality] for card in start.page.shown],
        "focus": start.page.focus if start.shown else "",
        "timeline_left": timeline.plots_view.left,  # column where frame 0 begins
        "timeline_width": timeline.plots_view.timeline.width,  # columns of all frames
        "zoom": timeline.zoom.shown,  # frames in the timeline; None for all
        "widgets": {
            name: [frame.x, frame.y, frame.width, frame.height]
            for name, frame in ((name, widget.frame) for name, widget in widgets.items())
        },
        "texts": {name: widget.text_value for name, widget in widgets.items() if hasattr(widget, "text_value")},
    }


def _parts(panels: Panels, layout: Layout, views: StageViews, dialogs: Dialogs) -> dict[str, dict[str, list[float]]]:
    """Places in the widgets that are images, by the names by which tests find them: of cameras and the ends of the
    scene's axes in the view, those in front last; of stages; of buttons in the log; of what the start page offers; of
    the strip of images and the plots in the timeline; and of what is in the open dialog."""
    log, view, timeline = panels.inspector, views.stage_view, panels.timeline
    cameras, ends = views.player.scene_places
    shown = view.places if view is not None else (*cameras, *ends) if views.shows_scene else ()
    size = panels.viewport.picture_size
    strip = timeline.strip_height / timeline.picture.size[1]
    return {
        "viewport": {name: [round(float(at), 4) for at in corners.mean(axis=0) / size] for name, corners in shown},
        "stages": {stage: [0.3, round((row + 0.5) / len(TITLES), 3)] for row, stage in enumerate(TITLES)},
        "log": log.view.areas.middles(log.log.size) if layout.shows_figures else {},
        "start page": panels.start.places if panels.start.shown else {},
        "timeline": {"images": [0.5, strip / 2], "plots": [0.5, (1 + strip) / 2]},
        **{f"dialog {key}": parts() for key, parts in dialogs.parts.items()},
    }


def _widgets(panels: Panels, views: StageViews, dialogs: Dialogs) -> dict[str, gui.Widget]:
    """All widgets that can be pressed or read, by the names by which tests find them."""
    stages = panels.stages
    settings = stages.settings[stages.selected]
    return {
        "viewport": panels.viewport.picture.widget,
        "timeline": panels.timeline.picture.widget,
        "stages": stages.list.widget,
        "inspector": panels.inspector.figures.widget,
        "log": panels.inspector.log.widget,
        "path": panels.path_panel.picture.widget,
        "status": panels.status,
        "hint": panels.hints.picture.widget,
        "start page": panels.start.picture.widget,
        **{f"notice {key}": button for key, button in panels.notice_bar.buttons.items()},
        **panels.controls.buttons,
        **stages.buttons,
        "error setting": stages.link,
        **{f"camera {key}": button for key, button in panels.camera_menu.buttons.items()},
        **{key: button for (row, key), button in panels.modes.buttons.items() if row == views.row},
        **{f"dialog {key}": widget for key, widget in dialogs.widgets.items()},
        "settings filter": settings.filter,
        **settings.widgets,
        **{f"setting {name}": editor for name, (_, editor) in settings.editors.items()},
    }


class StateLog:
    """Appends a JSON line to a file whenever the state has changed. FILE.ticks contains the number of ticks so far: a
    program that drives the window waits for a few of them to be sure that an input event has been processed.

    Args:
        path: the file; None for none.
        parts: functions that return parts of the state.
    """

    def __init__(self, path: Path | None, parts: Sequence[Callable[[], JsonObject]]) -> None:
        self._parts = parts
        self._file: TextIO | None = None
        self._last: dict[str, Any] = {}
        self._ticks = -1
        if path is not None:
            self._file = path.open("a", encoding="utf-8")
            self._ticks_file = path.with_name(path.name + ".ticks").open("wb", buffering=0)
            self.tick()  # 0: the first state is written before the first tick is counted

    def write(self) -> None:
        """Write the state if it has changed. Call at each tick."""
        if self._file is None:
            return
        state: JsonObject = {}
        for part in self._parts:
            state |= part()
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
