"""The dialog of the preferences."""

from collections.abc import Callable
from dataclasses import replace

from v3studio.gui.models.notices import Notices
from v3studio.gui.models.preferences import BACKGROUND_NAMES, PICTURE_SIZES, Preferences
from v3studio.gui.widgets.dialogs.base import Dialogs
from v3studio.gui.widgets.dialogs.form import Form


class PreferenceActions:
    """Asks for the preferences. `apply`: called after they have changed."""

    def __init__(self, preferences: Preferences, dialogs: Dialogs, notices: Notices, apply: Callable[[], None]) -> None:
        self._preferences, self._dialogs, self._notices, self._apply = preferences, dialogs, notices, apply

    def ask(self) -> None:
        chosen = replace(self._preferences)
        form = Form(self._dialogs, chosen)
        form.choice("picture_size", "Render resolution", list(PICTURE_SIZES))
        form.choice("background", "Background", BACKGROUND_NAMES)
        form.switch("play_on_opening", "Autoplay")

        def save() -> None:
            saved = self._preferences.keep(**vars(chosen))
            self._apply()
            words = "Preferences could not be saved; they apply until the window is closed."
            self._notices.outcome("preferences", "" if saved else words)

        form.show("preferences", "Preferences", [form.grid], ("save", "Save", self._dialogs.closing(save)), 60)
