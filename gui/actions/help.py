"""What the menu Help, the buttons `?` and those in the log do."""

from __future__ import annotations

from functools import partial

from open3d.visualization import gui

from gui.drawing.key_list import key_list
from gui.models.stage_rows import TITLES
from gui.models.take.remedies import Fix
from gui.shell import Shell
from gui.widgets.dialogs.base import BUTTON_PADDING
from gui.widgets.picture import FIELD_PADDING, as_image, lowered
from gui.widgets.stage_help import HELP, help_image

SHORTCUTS: dict[str, dict[str, str]] = {
    "Playback": {
        "Space": "play or pause",
        "Left, Right": "step one frame back or forward",
        "Home, End": "go to the first or last frame",
        "[ and ]": "go to the previous or next group",
        "L": "toggle looping",
        "V": "sound off or on",
        "T": "select a span of frames: from here, to here, none",
        "Drag the images": "above the timeline (or Shift + drag on it): select a span",
        "M": "mark the frame, with a note",
        "< and >": "go to the previous or next mark",
    },
    "View": {
        "Left drag": "orbit",
        "Right drag, Shift + drag": "pan",
        "Wheel": "zoom",
        "R": "reset the view",
        "C": "look through the next capture camera",
        "Z": "zoom to the performer in a capture camera's image; press again for the whole image",
        "Click, right click": "on a camera: look through it; its menu",
        "F": "fullscreen viewport (Escape exits)",
    },
    "Compare": {
        "1, 2, 3, 4": "show footage, trained, decoded, the other bake",
        "S": "side by side",
        "B": "what comparisons are against, and back",
        "W": "wipe; drag the line",
        "D": "difference heat map",
    },
    "Tools": {
        "X; - and +": "edit the take: trim, crop, clean, place the world; size of the brush",
        "O": "scene: splats with cameras, points, mesh, grid and axes",
        "K, P": "add the view to the camera path; show the editor of the path",
        "N, E, Delete, U, A": "points by hand: new, edit, remove mark, undo, toggle snapping",
        "Up, Down": "points by hand: select a point",
        "Ctrl+Z, Ctrl+Shift+Z": "undo, redo a change of settings, marks or edits",
    },
    "Window": {
        "H": "show or hide the start page; there, arrow keys and Enter choose, Ctrl+V opens a path",
        "Ctrl+K, Ctrl+Shift+P": "find a command by typing part of it",
        "I, J": "show or hide the inspector and log; enlarge the log",
        "Q": "show the queue of takes",
        "Escape, Ctrl+O": "dismiss the notice over the view, open its folder",
        "Ctrl+C": "copy its path or message, or else the table in the view",
        "F1, ?": "what to look for in the selected stage; this list",
    },
}
"""Keys and what they do, under headings."""

WIDTH, SHORTCUTS_WIDTH = 50, 66
"""Widths of the help of a stage and of the list of shortcuts, em."""


class HelpActions:
    """See the module; it acts through the main window."""

    def __init__(self, window: Shell) -> None:
        self._window = window

    def stage(self) -> None:
        """Show what to look for in the selected stage."""
        dialogs, stage = self._window.dialogs, self._window.stages.selected
        dialogs.widgets = {}
        image = gui.ImageWidget(as_image(help_image(stage, round(WIDTH * dialogs.em), dialogs.em)))
        row = gui.Horiz(0.4 * dialogs.em)
        down = round(BUTTON_PADDING * dialogs.em) + FIELD_PADDING
        row.add_child(lowered(dialogs.label("If it looks bad:"), down))
        for setting in HELP[stage].settings:
            action = dialogs.closing(partial(self._show, setting))
            row.add_child(dialogs.button(f"setting {setting}", setting, action))
        row.add_stretch()
        answers = [("close", "Close", dialogs.close)]
        dialogs.show("help", f"{TITLES[stage]}: what to look for", [image, row], answers, 40, dialogs.close)

    def shortcuts(self) -> None:
        """Show the shortcuts."""
        dialogs = self._window.dialogs
        dialogs.widgets = {}
        width = min(round(SHORTCUTS_WIDTH * dialogs.em), dialogs.room)
        image = gui.ImageWidget(as_image(key_list(SHORTCUTS, width, dialogs.em)))
        dialogs.show("message", "Shortcuts", [image], [("close", "Close", dialogs.close)], 40, dialogs.close)

    def apply_fix(self, fix: Fix) -> None:
        """Set the setting that fixes a warning, or show it where people must choose the value."""
        window = self._window
        if fix.sets and not fix.done:
            refusal = window.workspace.change_settings({fix.setting: fix.value})
            if not window.notices.outcome("setting", str(refusal or "")):
                return
            window.notices.show(f"{fix.setting} changed. Run again to use it; Ctrl+Z changes it back.")
        self._show(fix.setting)

    def _show(self, setting: str) -> None:
        window = self._window
        none = "Only a take has settings. Open one, or create one from footage."
        if window.notices.outcome("settings", none if window.workspace.config is None else ""):
            window.stages.show_setting(setting)
