"""What cameras are used for: training, evaluation, or nothing."""

from collections.abc import Mapping
from functools import partial

from v3studio.gui.models.notices import Notices
from v3studio.gui.models.take.workspace import Workspace
from v3studio.gui.widgets.dialogs.base import Dialogs
from v3studio.gui.widgets.dialogs.camera import ask_cameras
from v3studio.pipelines.takes.results.camera_uses import camera_uses, settings_of_uses
from v3studio.studio.errors import StudioError

USES = {  # uses of a camera: the item of its menu, and what that does
    "training": ("Use for training", "train on {}"),
    "held out": ("Hold out", "hold out {}"),
    "not used": ("Exclude (do not use)", "exclude {} from training"),
}


class CameraUseActions:
    """Changes the uses of cameras in the settings of the open take."""

    def __init__(self, workspace: Workspace, dialogs: Dialogs, notices: Notices) -> None:
        self._workspace, self._dialogs, self._notices = workspace, dialogs, notices

    def uses(self) -> dict[str, str]:
        """A key of `USES` by camera; none without a take whose footage can be read."""
        context = self._workspace.context
        if context is not None:
            with self._notices.reporting("cameras"):
                return camera_uses(context.capture)
        return {}

    def use(self, camera: str, use: str) -> None:
        """Change the use of a camera."""
        uses = self.uses()
        if not uses:
            return
        words = USES[use][1].format(camera)
        refused = self._change({**uses, camera: use}, words)
        if self._notices.outcome("camera use", refused):
            self._notices.show(f"{words[0].upper()}{words[1:]}: Ctrl+Z undoes it.")

    def ask(self) -> None:
        """Ask for the use of every camera."""
        uses = self.uses()
        if uses:
            ask_cameras(self._dialogs, uses, partial(self._change, words="the uses of cameras"))
        elif self._workspace.config is None:
            self._notices.show("Open a take first. A stream has no cameras to choose from.")

    def _change(self, uses: Mapping[str, str], words: str) -> str:
        """Write the cameras' uses to the settings; returns why that was refused, "" if it was not."""
        workspace = self._workspace
        if workspace.config is None:
            return "Open a take first."
        try:
            workspace.change_settings(settings_of_uses(uses, workspace.config.capture), words)
        except StudioError as error:
            return str(error)
        return ""
