"""The menu Help and the buttons `?`."""

from functools import partial

from open3d.visualization import gui

from v3studio.gui.actions.menus import Menus
from v3studio.gui.actions.settings import SettingRequests
from v3studio.gui.drawing.key_list import key_list
from v3studio.gui.models.notices import Notices
from v3studio.gui.models.stage_rows import TITLES
from v3studio.gui.models.take.page_words import setting_words
from v3studio.gui.pages.stage_views import StageViews
from v3studio.gui.widgets.dialogs.base import BUTTON_PADDING, Dialogs
from v3studio.gui.widgets.picture import FIELD_PADDING, as_image, lowered
from v3studio.gui.widgets.stage_help import HELP, help_image
from v3studio.pipelines.takes.take import program_version

KEYS: dict[str, dict[str, str]] = {  # keys and what they do, under headings, besides those of the menus
    "Playback": {
        "Space": "Play or pause",
        "Left, Right": "Previous, next frame",
        "Home, End": "First, last frame",
        "[ and ]": "Previous, next group",
        "L, V": "Loop; sound off or on",
        "Drag the images": "Above the timeline (or Shift + drag on it): select a span",
    },
    "View": {
        "Left drag": "Orbit",
        "Right drag, Shift + drag": "Pan",
        "Wheel": "Zoom",
        "Z": "Zoom to the performer, or show the whole image",
        "Click, right click": "On a camera: look through it; its menu",
    },
    "Compare": {
        "1, 2, 3, 4": "Footage, trained, decoded, the other bake or take",
        "B": "Switch between the stream and the other bake or take",
        "S, W, D": "Side by side; wipe (drag the line); difference heat map",
    },
    "Edit": {"- and +": "Size of the brush"},
    "Points by hand": {
        "N, E, Delete, U, A": "New, edit, remove mark, undo, toggle snapping",
        "Up, Down": "Select a point",
    },
    "Window": {
        "Arrow keys, Enter": "On the start page: choose; Ctrl+V opens a copied path",
        "Escape, Ctrl+O": "Dismiss the notice over the view; open its folder",
        "Ctrl+C": "Copy its path or message, or else the table in the view",
    },
}

WIDTH, SHORTCUTS_WIDTH = 50, 66  # widths of the help of a stage and of the list of shortcuts, em


class HelpActions:
    """Shows help in dialogs. `device`: name of the graphics device."""

    def __init__(
        self, views: StageViews, settings: SettingRequests, dialogs: Dialogs, notices: Notices, device: str
    ) -> None:
        self._views, self._settings = views, settings
        self._dialogs, self._notices, self._device = dialogs, notices, device

    def show_stage(self) -> None:
        """Show what to look for in the selected stage."""
        dialogs, stage = self._dialogs, self._views.stage
        if stage not in HELP:
            self._notices.show(f"There is no help on {TITLES[stage]}.")
            return
        image = gui.ImageWidget(as_image(help_image(stage, round(WIDTH * dialogs.em), dialogs.em)))
        row = gui.Horiz(0.4 * dialogs.em)
        down = round(BUTTON_PADDING * dialogs.em) + FIELD_PADDING
        row.add_child(lowered(dialogs.label("If it looks bad:"), down))
        for setting in HELP[stage].settings:
            action = dialogs.closing(partial(self._settings.show, setting))
            row.add_child(dialogs.button(f"setting {setting}", setting_words(setting), action))
        row.add_stretch()
        answers = [("close", "Close", dialogs.close)]
        dialogs.show("help", f"{TITLES[stage]}: what to look for", [image, row], answers, 40, dialogs.close)

    def show_shortcuts(self, menus: Menus) -> None:
        """Show the keys of the menus and those that have no item."""
        dialogs = self._dialogs
        width = min(round(SHORTCUTS_WIDTH * dialogs.em), dialogs.room)
        sections = {title: dict(keys) for title, keys in KEYS.items()}
        for title, items in menus.items():
            keys = {item.shortcut: item.words for item in items if item is not None and item.shortcut}
            sections[title] = sections.get(title, {}) | keys
        shown = {title: keys for title, keys in sections.items() if keys}
        image = gui.ImageWidget(as_image(key_list(shown, width, dialogs.em)))
        dialogs.show("message", "Shortcuts", [image], [("close", "Close", dialogs.close)], 40, dialogs.close)

    def about(self) -> None:
        """Show the version, the license and the graphics device."""
        text = (
            f"V3 Studio {program_version()}\n\nFrom synchronized multi-camera footage of a performer to a "
            "streamable Gaussian video.\nGNU General Public License, version 3 or later.\n\n"
            f"Graphics device: {self._device}"
        )
        self._dialogs.message("About", text)
