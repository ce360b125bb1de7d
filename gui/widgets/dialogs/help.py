"""Help dialogs: what to look for in a stage, and the shortcuts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

from open3d.visualization import gui

from gui.drawing.key_list import Section, key_list
from gui.models.stage_rows import TITLES
from gui.widgets.dialogs.base import BUTTON_PADDING, Answer, Dialogs
from gui.widgets.picture import FIELD_PADDING, as_image, lowered
from gui.widgets.stage_help import HELP, help_picture

WIDTH = 50
"""Width of the help of a stage, em."""

SHORTCUTS_WIDTH = 66
"""Width of the list of shortcuts, em."""


def show_stage_help(dialogs: Dialogs, stage: str, show_setting: Callable[[str], None]) -> None:
    """Show what to look for in a stage.

    Args:
        dialogs: shows it.
        stage: key of `TITLES`.
        show_setting: called with the setting whose button was pressed, after the dialog is closed.
    """
    dialogs.widgets = {}
    image = gui.ImageWidget(as_image(help_picture(stage, round(WIDTH * dialogs.em), dialogs.em)))
    row = gui.Horiz(0.4 * dialogs.em)
    down = round(BUTTON_PADDING * dialogs.em) + FIELD_PADDING
    row.add_child(lowered(dialogs.label("If it looks bad:"), down))
    for setting in HELP[stage].settings:
        row.add_child(dialogs.button(f"setting {setting}", setting, _closing(dialogs, partial(show_setting, setting))))
    row.add_stretch()
    answers: list[Answer] = [("close", "Close", dialogs.close)]
    dialogs.show("help", f"{TITLES[stage]}: what to look for", [image, row], answers, 40, dialogs.close)


def show_shortcuts(dialogs: Dialogs, sections: Sequence[Section]) -> None:
    """Show the shortcuts, see `key_list`."""
    dialogs.widgets = {}
    image = gui.ImageWidget(
        as_image(key_list(sections, min(round(SHORTCUTS_WIDTH * dialogs.em), dialogs.room), dialogs.em))
    )
    dialogs.show("message", "Shortcuts", [image], [("close", "Close", dialogs.close)], 40, dialogs.close)


def _closing(dialogs: Dialogs, action: Callable[[], object]) -> Callable[[], None]:
    def go() -> None:
        dialogs.close()
        action()

    return go
