"""What the menu Help, the buttons `?` and those in the log do."""

from __future__ import annotations

from gui.actions.keys import SHORTCUTS
from gui.models.take.remedies import Fix
from gui.shell import Shell
from gui.widgets.dialogs.help import show_shortcuts, show_stage_help


class HelpActions:
    """See the module.

    Args:
        window: the main window.
    """

    def __init__(self, window: Shell) -> None:
        self._window = window

    def stage(self) -> None:
        """Show what to look for in the selected stage."""
        window = self._window
        show_stage_help(window.dialogs, window.stages.selected, self._show)

    def shortcuts(self) -> None:
        """Show the shortcuts."""
        show_shortcuts(self._window.dialogs, SHORTCUTS)

    def apply_fix(self, fix: Fix) -> None:
        """Set the setting that fixes a warning, or show it where people must choose the value."""
        window = self._window
        if fix.sets and not fix.done:
            refusal = window.workspace.change_settings({fix.setting: fix.value})
            if refusal is not None:
                window.notices.tell(str(refusal), bad=True, topic="setting")
                return
            window.notices.clear("setting")
            window.notices.tell(f"{fix.setting} changed. Run again to use it; Ctrl+Z changes it back.")
        self._show(fix.setting)

    def _show(self, setting: str) -> None:
        window = self._window
        if window.workspace.config is None:
            words = "Only a take has settings. Open one, or create one from footage."
            window.notices.tell(words, bad=True, topic="settings")
            return
        window.notices.clear("settings")
        window.stages.show_setting(setting)
