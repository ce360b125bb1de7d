"""What a click on a camera does, its menu, and the list of all cameras."""

from functools import partial

import numpy as np

from gui.drawing.compare import ALONE
from gui.models.evaluation import WorstFrame
from gui.models.loop import later
from gui.models.playback.image_zoom import ImageZoom
from gui.models.playback.thumbnails import Thumbnails
from gui.models.take.cameras import camera_facts, change_uses
from gui.pages.capture.view import MASKS
from gui.shell import Shell
from gui.widgets.camera_menu import Item
from gui.widgets.dialogs.camera import ask_cameras
from gui.widgets.dialogs.worst import WorstDialog
from pipelines.takes.camera_uses import CameraUses


class CameraActions:
    """See the module; it acts through the main window."""

    def __init__(self, window: Shell) -> None:
        self._window = window
        self.thumbnails = Thumbnails()
        self._worst = WorstDialog(window.dialogs, self._show_frame, self._picture)
        self.thumbnails.changed.connect(self._worst.update)
        self.thumbnails.changed.connect(window.changed)
        views, garbage, notices = window.views, window.views.capture.garbage, window.notices
        views.clicked.connect(lambda: window.camera_menu.close())
        views.camera_clicked.connect(self._clicked)
        views.camera_menu.connect(later(self._open_menu))
        garbage.refused.connect(partial(notices.show, bad=True, topic="garbage"))
        garbage.written.connect(partial(notices.clear, "garbage"))

    def _clicked(self, camera: str) -> None:
        if self._window.views.stage == "capture":
            self._window.views.show_alone(camera)
        else:
            self.look_through(camera)

    def look_through(self, camera: str) -> None:
        """Show the performer from a camera; its footage while nothing is trained."""
        window = self._window
        player = window.player
        if camera in player.camera_names and player.source is not None:
            window.select("review")
            player.look_through(camera)
        else:
            self._alone(camera)

    def show_worst(self) -> None:
        """Show the worst evaluated frames; choosing one compares it with the footage of its camera."""
        self._worst.show(self._window.evaluation, self._window.player.transport.number)

    def _show_frame(self, worst: WorstFrame) -> None:
        player = self._window.player
        self.look_through(worst.camera)
        if player.mode in ALONE:
            player.choose_mode("side by side")
        player.transport.pause()
        player.transport.seek(worst.frame)

    def _picture(self, worst: WorstFrame, size: tuple[int, int]) -> np.ndarray | None:
        player = self._window.player
        if player.opened is None or player.opened.rig is None or worst.camera not in player.camera_names:
            return None
        camera = player.opened.rig[worst.camera].undistorted()
        view = ImageZoom.around(player.points, camera, *size).camera(camera, *size)
        return self.thumbnails.get(player.opened.path, player.contents, view, worst.frame, size)

    def _alone(self, camera: str) -> None:
        views = self._window.views
        self._window.select("capture")
        views.show_alone(camera, toggle=False)

    def _masks(self, camera: str) -> None:
        self._alone(camera)
        self._window.views.capture.mode = MASKS

    def _errors(self, camera: str) -> None:
        self._window.select("calibrate")
        self._window.views.choose("report")
        self._window.views.stage_views["calibrate"].camera = camera

    def _open_menu(self, camera: str) -> None:
        window = self._window
        take = window.workspace.take
        uses = self._uses()
        if take is None or uses is None or camera not in uses.uses:
            return
        use = uses.uses[camera]
        items: list[Item] = [
            ("look", "Look through", lambda: self.look_through(camera)),
            ("masks", "Show its masks", lambda: self._masks(camera)),
        ]
        if take.rig.is_file():
            items.append(("errors", "Show its reprojection errors", lambda: self._errors(camera)))
        for other, label in (
            ("training", "Use for training"),
            ("held out", "Hold out"),
            ("not used", "Exclude (do not use)"),
        ):
            if other != use:
                items.append((other, label, partial(self._use, camera, other)))
        items.append(("list", "All cameras...", self.ask))
        window.camera_menu.open(
            window.viewport.clicked_at, camera, use, camera_facts(take, window.evaluation, camera), items
        )
        window.window.set_needs_layout()

    def _uses(self) -> CameraUses | None:
        context = self._window.workspace.context
        if context is None:
            return None
        with self._window.notices.reporting("cameras"):
            return CameraUses.of(context.footage.capture)
        return None

    def _use(self, camera: str, use: str) -> None:
        uses = self._uses()
        if uses is None:
            return
        words = {
            "training": f"train on {camera}",
            "held out": f"hold out {camera}",
            "not used": f"exclude {camera} from training",
        }[use]
        refused = change_uses(self._window.workspace, uses.with_use(use, camera), words)
        notices = self._window.notices
        if notices.outcome("camera use", refused):
            notices.show(f"{words[0].upper()}{words[1:]}: Ctrl+Z undoes it.")

    def ask(self) -> None:
        """Ask for the use of every camera."""
        window = self._window
        uses = self._uses()
        if uses is None:
            if window.workspace.config is None:
                window.notices.show("Open a take first. A stream has no cameras to choose from.")
            return

        def save(chosen: CameraUses) -> str:
            return change_uses(window.workspace, chosen, "the uses of cameras")

        ask_cameras(window.dialogs, uses, save)
