"""Cameras: clicks on them, their menu, and what they are used for."""

from collections.abc import Callable, Mapping
from functools import partial

from v3studio.gui.drawing.compare import What
from v3studio.gui.figures import QualityFigures
from v3studio.gui.models.evaluation import Evaluation
from v3studio.gui.models.loop import later
from v3studio.gui.models.notices import Notices
from v3studio.gui.models.playback.player import PlayerPresenter
from v3studio.gui.models.take.workspace import Workspace
from v3studio.gui.pages.choices import ViewMode
from v3studio.gui.pages.stage_views import StageViews
from v3studio.gui.viewport import Viewport
from v3studio.gui.widgets.camera_menu import CameraMenu, Item
from v3studio.gui.widgets.dialogs.base import Dialogs
from v3studio.gui.widgets.dialogs.camera import ask_cameras
from v3studio.pipelines.takes.results.camera_uses import camera_uses, settings_of_uses
from v3studio.pipelines.takes.results.stage_files import checked_cameras
from v3studio.pipelines.takes.take import Take
from v3studio.studio.calibration.report import CalibrationReport
from v3studio.studio.comparison.metrics import MAIN
from v3studio.studio.errors import StudioError

USES = {  # uses of a camera: the item of its menu, and what that does
    "training": ("Use for training", "train on {}"),
    "held out": ("Hold out", "hold out {}"),
    "not used": ("Exclude (do not use)", "exclude {} from training"),
}


class CameraActions:
    """Shows one camera: its footage, its masks, its errors, or the performer from it; opens its menu, and changes the
    uses of cameras in the settings of the open take. `lay_out`: has the window laid out again."""

    def __init__(
        self, player: PlayerPresenter, workspace: Workspace, views: StageViews, quality: QualityFigures,
        viewport: Viewport, menu: CameraMenu, dialogs: Dialogs, notices: Notices, lay_out: Callable[[], None],
    ) -> None:  # fmt: skip
        self._player, self._workspace, self._views, self._quality = player, workspace, views, quality
        self._viewport, self._menu, self._dialogs, self._notices = viewport, menu, dialogs, notices
        self._lay_out = lay_out
        views.camera_clicked.connect(self._clicked)
        views.camera_menu.connect(later(self._open_menu))

    def _clicked(self, camera: str) -> None:
        if self._views.stage == "capture":
            self._views.show_alone(camera)
        else:
            self.look_through(camera)

    def look_through(self, camera: str) -> None:
        """Show the performer from a camera; its footage while nothing is trained."""
        player = self._player
        if camera in player.camera_names and player.source is not None:
            self._views.select("review")
            player.look_through(camera)
        else:
            self._alone(camera)

    def _alone(self, camera: str) -> None:
        self._views.select("capture")
        self._views.show_alone(camera, toggle=False)

    def show_masks(self, camera: str) -> None:
        """Show the camera's footage with its masks."""
        self._alone(camera)
        self._views.capture.mode = ViewMode.MASKS

    def show_errors(self, camera: str) -> None:
        """Show the camera's reprojection errors."""
        self._views.select("calibrate")
        self._views.choose(ViewMode.REPORT)
        self._views.stage_views["calibrate"].camera = camera

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

    def _open_menu(self, camera: str) -> None:
        take, uses = self._workspace.take, self.uses()
        if take is None or camera not in uses:
            return
        items: list[Item] = [
            ("look", "Look through", partial(self.look_through, camera)),
            ("masks", "Show its masks", partial(self.show_masks, camera)),
        ]
        if take.rig.is_file():
            items.append(("errors", "Show its reprojection errors", partial(self.show_errors, camera)))
        for other, (label, _) in USES.items():
            if other != uses[camera]:
                items.append((other, label, partial(self.use, camera, other)))
        items.append(("list", "All cameras...", self.ask))
        facts = camera_facts(take, self._quality.evaluation, camera)
        self._menu.open(self._viewport.clicked_at, camera, uses[camera], facts, items)
        self._lay_out()


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
    measured = {what: evaluation.mean(camera, what) for what in (What.TRAINED, What.DECODED)}
    words = ", ".join(f"{MAIN.text(value)} {what}" for what, value in measured.items() if value is not None)
    rows.append((MAIN.title, words or "not evaluated"))
    return rows
