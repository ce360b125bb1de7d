"""What a click on a camera does, its menu, and the list of all cameras."""

from collections.abc import Mapping
from functools import partial

import numpy as np

from v3studio.gui.drawing.compare import ALONE
from v3studio.gui.models.evaluation import Evaluation, WorstFrame
from v3studio.gui.models.loop import later
from v3studio.gui.models.playback.image_zoom import ImageZoom
from v3studio.gui.pages.capture.view import MASKS
from v3studio.gui.shell import Shell
from v3studio.gui.widgets.camera_menu import Item
from v3studio.gui.widgets.dialogs.camera import ask_cameras
from v3studio.gui.widgets.dialogs.worst import WorstDialog
from v3studio.pipelines.takes.results.camera_uses import camera_uses, settings_of_uses
from v3studio.pipelines.takes.results.stage_files import checked_cameras
from v3studio.pipelines.takes.take import Take
from v3studio.studio.calibration.report import CalibrationReport
from v3studio.studio.comparison.metrics import MAIN
from v3studio.studio.errors import StudioError

_USES = {  # what a camera is used for: the item of its menu, and what that does
    "training": ("Use for training", "train on {}"),
    "held out": ("Hold out", "hold out {}"),
    "not used": ("Exclude (do not use)", "exclude {} from training"),
}


class CameraActions:
    """See the module; it acts through the main window."""

    def __init__(self, window: Shell) -> None:
        self._window = window
        self._worst = WorstDialog(window.dialogs, self._show_frame, self._picture)
        window.thumbnails.changed.connect(self._worst.update)
        views = window.views
        views.clicked.connect(lambda: window.camera_menu.close())
        views.camera_clicked.connect(self._clicked)
        views.camera_menu.connect(later(self._open_menu))
        views.capture.garbage.outcome.connect(partial(window.notices.outcome, "garbage"))

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
            window.views.select("review")
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
        return self._window.thumbnails.get(player.opened.path, player.contents, view, worst.frame, size)

    def _alone(self, camera: str) -> None:
        views = self._window.views
        self._window.views.select("capture")
        views.show_alone(camera, toggle=False)

    def _masks(self, camera: str) -> None:
        self._alone(camera)
        self._window.views.capture.mode = MASKS

    def _errors(self, camera: str) -> None:
        self._window.views.select("calibrate")
        self._window.views.choose("report")
        self._window.views.stage_views["calibrate"].camera = camera

    def _open_menu(self, camera: str) -> None:
        window = self._window
        take = window.workspace.take
        uses = self._uses()
        if take is None or uses is None or camera not in uses:
            return
        use = uses[camera]
        items: list[Item] = [
            ("look", "Look through", lambda: self.look_through(camera)),
            ("masks", "Show its masks", lambda: self._masks(camera)),
        ]
        if take.rig.is_file():
            items.append(("errors", "Show its reprojection errors", lambda: self._errors(camera)))
        for other, (label, _) in _USES.items():
            if other != use:
                items.append((other, label, partial(self._use, camera, other)))
        items.append(("list", "All cameras...", self.ask))
        window.camera_menu.open(
            window.viewport.clicked_at, camera, use, camera_facts(take, window.evaluation, camera), items
        )
        window.window.set_needs_layout()

    def _uses(self) -> dict[str, str] | None:
        context = self._window.workspace.context
        if context is None:
            return None
        with self._window.notices.reporting("cameras"):
            return camera_uses(context.capture)
        return None

    def _use(self, camera: str, use: str) -> None:
        uses = self._uses()
        if uses is None:
            return
        words = _USES[use][1].format(camera)
        refused = self._change({**uses, camera: use}, words)
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
        ask_cameras(window.dialogs, uses, partial(self._change, words="the uses of cameras"))

    def _change(self, uses: Mapping[str, str], words: str) -> str:
        """Write the cameras' uses to the settings; returns why that was refused, "" if it was not."""
        workspace = self._window.workspace
        if workspace.config is None:
            return "Open a take first."
        try:
            workspace.change_settings(settings_of_uses(uses, workspace.config.capture), words)
        except StudioError as error:
            return str(error)
        return ""


def camera_facts(take: Take, evaluation: Evaluation, camera: str) -> list[tuple[str, str]]:
    """(name, value) of what is known about a camera: its reprojection errors and its quality, mean over the frames."""
    rows: list[tuple[str, str]] = []
    checked = checked_cameras(take)
    report = checked.report
    figures = report.cameras.get(camera) if isinstance(report, CalibrationReport) else None
    if figures is not None:
        rows.append(("reprojection error", f"mean {figures.mean:.2f} px, p95 {figures.p95:.2f} px"))
        rows.append(("points", f"{figures.observations}, on {100 * figures.coverage:.0f}% of the image"))
    elif report is not None:
        rows.append(("reprojection error", "not known: cameras from a file"))
    check = checked.verdict.cameras.get(camera) if checked.verdict is not None else None
    if check is not None and check.fits is not None:
        rows.append(("matches", f"{check.fits:.0%} of {check.matches} fit"))
    if check is not None and check.mask_error is not None:
        rows.append(("mask", f"{check.mask_error:.0%} off the others' volume"))
    measured = {what: evaluation.mean(camera, what) for what in ("trained", "decoded")}
    words = ", ".join(f"{MAIN.text(value)} {what}" for what, value in measured.items() if value is not None)
    rows.append((MAIN.title, words or "not evaluated"))
    return rows
