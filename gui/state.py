"""What the window shows, as plain values, for tests and bug reports."""

from __future__ import annotations

import json
import os
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

from gui.pages.review.session import edits_of
from gui.shell import Shell
from pipelines.takes.edits import describe

if TYPE_CHECKING:
    from open3d.visualization import gui


@dataclass(frozen=True)
class WindowState:
    """A line of `--log-state`.

    Attributes:
        title, message: title of the window; text over the viewport.
        opening: path or URL being opened; "" if none.
        dialog: name of the open dialog; "" if none.
        typing: whether the dialog's text field has the keyboard focus.
        lines: what the dialog's list shows, where that changes without the user.
        stage, mode: the selected stage and the pressed buttons above the viewport.
        edits, selected: the take's edits in words; number of splats that are selected for removal.
        fullscreen, figures: whether the panels are hidden; whether the right panel is visible.
        stages: [state, words, detail] by stage.
        busy, error: whether a run is in progress on the take; message in the left panel.
        error_setting: the setting that the button under this message opens; "" if none.
        frame, frames, playing, loop: state of the transport.
        span: first and last frame of the selected span; None for none.
        fixes: the middle of each button in the log, 0 to 1 across and down, by its label.
        left_out: messages about damaged groups that playback skipped.
        what, compare, wipe: source on screen, comparison mode, position of the wipe, 0 to 1.
        camera: capture camera; "" for the free view.
        alone: the camera that Capture shows alone; "" for all.
        menu_camera: the camera whose menu is open; "" if none is.
        places: the middle of what shows a camera, and of the ends of the scene's axes, 0 to 1 across and down the
            viewport; those in front last.
        shown: frame of the newest image; None if there is none.
        settled: whether the newest image shows what was last requested.
        pictures: number of images shown so far.
        handed_over: images per second.
        notice: the newest notice; "" if there is none.
        start: whether the start page is on screen.
        cards: what the start page shows of recent takes: name, state, quality.
        start_places: the middle of what can be chosen there, 0 to 1 across and down, by name.
        focus: what has the keyboard focus there.
        numbers: the frame that the image, the figures and the timeline show; None for what shows none.
        exporting: progress of the export or share; "" if none is running.
        serving: URL at which the take is served; "" if it is not.
        marks: notes by frame number, as text.
        path: [time, frame, easing] of each view of the camera path.
        path_places: the middle of what can be clicked in its panel, 0 to 1 across and down, by name and row.
        orbit: yaw, pitch, distance, target (x, y, z).
        background: name of the viewport's background.
        timeline_left, timeline_width: column of the timeline where frame 0 begins, and columns of all frames, pixels.
        hint: tooltip of the button under the pointer; "" if there is none.
        keys: number of key presses passed on to the toolkit, and of its reports of one press again, which were dropped.
        widgets: [x, y, width, height] in window pixels by name; visible widgets only.
        texts: content of each visible text field, by widget name.
    """

    title: str
    message: str
    opening: str
    dialog: str
    typing: bool
    lines: list[str]
    stage: str
    mode: list[str]
    edits: dict[str, str]
    selected: int
    fullscreen: bool
    figures: bool
    stages: dict[str, list[str]]
    busy: bool
    error: str
    error_setting: str
    frame: int
    frames: int
    playing: bool
    loop: bool
    span: list[int] | None
    fixes: dict[str, tuple[float, float]]
    left_out: list[str]
    what: str
    compare: str
    wipe: float
    camera: str
    alone: str
    menu_camera: str
    places: dict[str, list[float]]
    shown: int | None
    settled: bool
    pictures: int
    handed_over: int
    notice: str
    start: bool
    cards: list[list[object]]
    start_places: dict[str, list[float]]
    focus: str
    numbers: list[int | None]
    exporting: str
    serving: str
    marks: dict[str, str]
    path: list[list[object]]
    path_places: dict[str, list[float]]
    orbit: list[float]
    background: str
    timeline_left: int
    timeline_width: int
    hint: str
    keys: list[int]
    widgets: dict[str, list[int]]
    texts: dict[str, str]

    @classmethod
    def of(cls, window: Shell) -> WindowState:
        """The current state of a window."""
        player, stages = window.player, window.stages
        widgets = {name: widget for name, widget in _widgets(window).items() if widget.visible or name == "viewport"}
        return cls(
            title=window.title,
            message=window.message.text,
            opening=window.opening,
            dialog=window.dialogs.name,
            typing=window.dialogs.typing,
            lines=window.dialogs.lines,
            stage=window.views.stage,
            mode=sorted(window.views.chosen()),
            edits=describe(edits_of(window.workspace)),
            selected=window.views.editor.counts.get("selected", 0) if window.views.edits_take else 0,
            fullscreen=window.layout.fullscreen,
            figures=window.layout.shows_figures,
            stages={row.key: [row.state, row.words, row.detail] for row in window.workspace.rows()},
            busy=window.workspace.busy,
            error=stages.error.text,
            error_setting=stages.error_setting,
            frame=player.transport.frame,
            frames=player.transport.frame_count,
            playing=player.transport.playing,
            loop=player.transport.loop,
            span=list(player.transport.span) if player.transport.span is not None else None,
            fixes=window.inspector.fixes if window.layout.shows_figures else {},
            left_out=player.left_out,
            what=player.what,
            compare=player.mode,
            wipe=round(player.wipe, 3),
            camera=player.camera,
            alone=window.views.capture.camera,
            menu_camera=window.camera_menu.camera,
            places=_places(window),
            shown=player.picture.frame if player.picture else None,
            settled=window.views.settled,
            pictures=window.pictures,
            handed_over=round(player.rate),
            notice=window.notices.text,
            start=window.start.shown,
            cards=[[card.name, card.state, card.quality] for card in window.start.cards],
            start_places=window.start.places if window.start.shown else {},
            focus=window.start.focus if window.start.shown else "",
            numbers=window.numbers,
            exporting=window.exports.words,
            serving=window.serving.address,
            marks={str(frame): note for frame, note in sorted(window.marks.notes.items())},
            path=[[round(key.time, 3), key.frame, key.easing] for key in window.exports.path.keys],
            path_places=window.path_panel.places if window.path_panel.shown else {},
            orbit=[player.orbit.yaw, player.orbit.pitch, player.orbit.distance, *player.orbit.target.tolist()],
            background=player.background,
            timeline_left=window.timeline.plots_view.left,
            timeline_width=window.timeline.plots_view.timeline.width,
            hint=window.hints.text,
            keys=[window.input.reports.passed, window.input.reports.again],
            widgets={
                name: [widget.frame.x, widget.frame.y, widget.frame.width, widget.frame.height]
                for name, widget in widgets.items()
            },
            texts={name: widget.text_value for name, widget in widgets.items() if hasattr(widget, "text_value")},
        )


def _places(window: Shell) -> dict[str, list[float]]:
    view, size = window.views.stage_view, window.viewport.picture_size
    if view is None:
        cameras, ends = window.player.scene_places
        found = (*cameras, *ends) if window.views.shows_scene else ()
        return {name: [round(float(at), 4) for at in corners.mean(axis=0) / size] for name, corners in found}
    return {name: [round(float(at), 4) for at in corners.mean(axis=0) / size] for name, corners in view.places}


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
    """Appends a JSON line to a file whenever the state has changed.

    FILE.ticks contains the number of ticks so far: a program that drives the window waits for a few of them to be sure
    that an input event has been processed.

    Args:
        path: the file; None for no log.
    """

    def __init__(self, path: Path | None) -> None:
        self._file: TextIO | None = None
        self._last: WindowState | None = None
        self._ticks = 0
        if path is not None:
            self._file = path.open("a", encoding="utf-8")
            self._ticks_file = path.with_name(path.name + ".ticks").open("wb", buffering=0)
            self._count(0)  # the first state is written before the first tick is counted

    def write(self, window: Shell) -> None:
        """Call at each tick."""
        if self._file is None:
            return
        state = WindowState.of(window)
        if state != self._last:
            self._last = state
            self._file.write(json.dumps({"time": time.time(), **asdict(state)}) + "\n")
            self._file.flush()
        self.tick()  # after the line, so that after waiting for a tick one reads a state at least as new

    def tick(self) -> None:
        """Count a tick at rest."""
        if self._file is not None:
            self._count(self._ticks + 1)

    def _count(self, ticks: int) -> None:
        self._ticks = ticks
        os.pwrite(self._ticks_file.fileno(), b"%12d" % ticks, 0)

    def close(self) -> None:
        """Close the files."""
        if self._file is not None:
            self._file.close()
            self._ticks_file.close()
