"""What is known about each camera, and changes of what it is used for."""

from gui.models.evaluation import Evaluation
from gui.models.take.workspace import Workspace
from pipelines.takes.camera_uses import CameraUses
from pipelines.takes.checked_cameras import CheckedCameras, checked_cameras
from pipelines.takes.take import Take
from studio.calibration.report import CalibrationReport
from studio.comparison.metrics import MAIN
from studio.errors import StudioError


def camera_facts(take: Take, evaluation: Evaluation, camera: str) -> list[tuple[str, str]]:
    """(name, value) of what is known about a camera: its reprojection errors and its quality, mean over the frames."""
    rows: list[tuple[str, str]] = []
    checked = checked_cameras(take) if take.rig.is_file() else CheckedCameras(None, None, None)
    report = checked.report
    figures = report.cameras.get(camera) if isinstance(report, CalibrationReport) else None
    if figures is not None:
        rows.append(("reprojection error", f"mean {figures.mean:.2f} px, p95 {figures.p95:.2f} px"))
        rows.append(("points", f"{figures.observations}, on {100 * figures.coverage:.0f}% of the image"))
    elif take.rig.is_file():
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


def change_uses(workspace: Workspace, uses: CameraUses, words: str) -> str:
    """Write the cameras' uses to the settings; returns why that was refused, "" if it was not."""
    config = workspace.config
    if config is None:
        return "Open a take first."
    try:
        refusal = workspace.change_settings(uses.settings(config.capture), words)
    except StudioError as error:
        return str(error)
    return str(refusal or "")
