"""Requests of panels and dialogs about settings: choosing a file, applying the fix of a warning, showing one."""

from functools import partial

from v3studio.gui.models.notices import Notices
from v3studio.gui.models.take.page_words import setting_words
from v3studio.gui.models.take.remedies import Fix
from v3studio.gui.models.take.setting_words import FOLDERS
from v3studio.gui.models.take.settings import SettingField, place_of
from v3studio.gui.models.take.workspace import Workspace
from v3studio.gui.pages.stage_views import StageViews
from v3studio.gui.widgets.dialogs.base import Dialogs
from v3studio.gui.widgets.dialogs.folder import ask_path
from v3studio.gui.widgets.stages import StagesPanel


class SettingRequests:
    """Changes settings, and shows them in the left panel."""

    def __init__(
        self, workspace: Workspace, panel: StagesPanel, views: StageViews, dialogs: Dialogs, notices: Notices
    ) -> None:
        self._workspace, self._panel, self._dialogs, self._notices = workspace, panel, dialogs, notices
        self._views = views

    def pick(self, field: SettingField) -> None:
        """Choose the file or the folder of a setting in a dialog."""
        config = self._workspace.config
        if config is None:
            return
        title, kind = field.label[:1].upper() + field.label[1:], "folder" if field.name in FOLDERS else "file"
        ask_path(self._dialogs, title, place_of(field, config), kind, partial(self._panel.set_text, field))

    def apply_fix(self, fix: Fix) -> None:
        """Set the setting that fixes a warning, or show what people must look at: it, or a mask."""
        if fix.camera:
            self._views.select("capture")
            self._views.show_mask(fix.camera, fix.frame)
            return
        with self._notices.reporting("setting"):
            if fix.sets and not fix.done:
                self._workspace.change_settings({fix.setting: fix.value})
                words = f"{setting_words(fix.setting)} changed. Run again to use it; Ctrl+Z changes it back."
                self._notices.show(words)
            self.show(fix.setting)

    def show(self, setting: str) -> None:
        """Show a setting in the left panel."""
        none = "Only a take has settings. Open one, or create one from footage."
        if self._notices.outcome("settings", none if self._workspace.config is None else ""):
            self._panel.show_setting(setting)
