"""What the window shows, as plain values, for tests and bug reports."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

from gui.shell import Shell

if TYPE_CHECKING:
    from open3d.visualization import gui


def state_of(window: Shell) -> dict[str, Any]:
    """All that a test may want to know."""
    player = window.player
    return {
        "title": player.title,
        "message": window.message.text,
        "opening": window.opening,
        "dialog": window.dialogs.name,
        "typing": window.dialogs.typing,
        "stage": window.views.stage,
        "mode": sorted(window.views.chosen()),
        "fullscreen": window.layout.fullscreen,
        "figures": window.layout.shows_figures,
        "stages": {row.key: [row.state, row.words, row.detail] for row in window.workspace.rows()},
        "busy": window.workspace.busy,
        "error": window.stages.error.text,
        "frame": player.transport.frame,
        "frames": player.transport.frame_count,
        "playing": player.transport.playing,
        "loop": player.transport.loop,
        "left_out": player.left_out,
        "what": player.what,
        "compare": player.mode,
        "wipe": round(player.wipe, 3),
        "camera": player.camera,
        "shown": player.picture.frame if player.picture else None,
        "settled": window.views.settled,
        "pictures": window.pictures,
        "handed_over": round(player.rate),
        "exporting": window.exports.words,
        "marks": {str(frame): note for frame, note in sorted(window.marks.notes.items())},
        "orbit": [player.orbit.yaw, player.orbit.pitch, player.orbit.distance, *player.orbit.target.tolist()],
        "background": player.background,
        "timeline_left": window.timeline.plots_view.left,
        "widgets": {
            name: [widget.frame.x, widget.frame.y, widget.frame.width, widget.frame.height]
            for name, widget in _widgets(window).items()
            if widget.visible or name == "viewport"
        },
    }


def _widgets(window: Shell) -> dict[str, gui.Widget]:
    settings = window.stages.settings[window.stages.selected]
    return {
        "viewport": window.viewport.picture.widget,
        "timeline": window.timeline.picture.widget,
        "stages": window.stages.list.widget,
        "inspector": window.inspector.figures.widget,
        "log": window.inspector.log.widget,
        **window.controls.buttons,
        **window.stages.buttons,
        **{key: button for (stage, key), button in window.modes.buttons.items() if stage == window.views.stage},
        **{f"dialog {key}": widget for key, widget in window.dialogs.widgets.items()},
        "settings filter": settings.filter,
        **{f"setting {name}": editor for name, (_, editor) in settings.editors.items()},
    }


class StateLog:
    """Appends a JSON line to a file whenever what is shown has changed.

    Args:
        path: the file; None for no log.
    """

    def __init__(self, path: Path | None) -> None:
        self._file: TextIO | None = path.open("a", encoding="utf-8") if path else None
        self._last: dict[str, Any] = {}

    def write(self, window: Shell) -> None:
        """Call at each tick."""
        if self._file is None:
            return
        state = state_of(window)
        if state != self._last:
            self._last = state
            self._file.write(json.dumps({"time": time.time(), **state}) + "\n")
            self._file.flush()

    def close(self) -> None:
        """Close the file."""
        if self._file is not None:
            self._file.close()
