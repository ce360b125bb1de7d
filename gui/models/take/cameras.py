"""What each camera is used for: training, evaluation (held out), or nothing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from statistics import fmean
from typing import Self

from gui.models.evaluation import Evaluation
from gui.models.take.workspace import Workspace
from pipelines.takes.checked_cameras import CheckedCameras, checked_cameras
from pipelines.takes.take import Take
from studio.calibration.report import CalibrationReport
from studio.capture import CaptureSettings, find_cameras, held_out_cameras
from studio.comparison.metrics import MAIN
from studio.errors import StudioError

USES = ("training", "held out", "not used")
"""What a camera can be used for."""


@dataclass(frozen=True)
class CameraUses:
    """See the module.

    Attributes:
        uses: one of `USES` by camera, in the footage's order.
    """

    uses: Mapping[str, str]

    @classmethod
    def of(cls, spec: CaptureSettings) -> Self:
        """As the settings say.

        Raises:
            StudioError: there is no footage, or the settings name unknown cameras.
        """
        names = find_cameras(spec)
        used = tuple(name for name in names if not spec.cameras or name in spec.cameras)
        held_out = held_out_cameras(spec, used)
        return cls(
            {name: "held out" if name in held_out else "training" if name in used else "not used" for name in names}
        )

    def with_use(self, camera: str, use: str) -> Self:
        """A copy with another use of one camera.

        Raises:
            ValueError: `use` is not one of `USES`.
        """
        if use not in USES:
            raise ValueError(f"use must be one of {', '.join(USES)}, got {use!r}")
        return replace(self, uses={**self.uses, camera: use})

    def settings(self, spec: CaptureSettings) -> dict[str, object]:
        """Values of settings, by dotted name, that give the cameras these uses.

        Args:
            spec: the present settings; offsets of cameras that are no longer used are removed, as they are refused.

        Raises:
            StudioError: no camera would be left to train on.
        """
        used = [name for name, use in self.uses.items() if use != "not used"]
        if "training" not in self.uses.values():
            raise StudioError("gui.no_training_camera", "no camera is left to train on", fix="Use at least one for it.")
        values: dict[str, object] = {
            "capture.cameras": [] if len(used) == len(self.uses) else used,
            "capture.held_out": [name for name, use in self.uses.items() if use == "held out"],
        }
        if any(name not in used for name in spec.offsets):
            values["capture.offsets"] = {name: offset for name, offset in spec.offsets.items() if name in used}
        return values


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
    measured = {what: quality(evaluation, camera, what) for what in ("trained", "decoded")}
    words = ", ".join(f"{MAIN.text(value)} {what}" for what, value in measured.items() if value is not None)
    rows.append((MAIN.title, words or "not evaluated"))
    return rows


def quality(evaluation: Evaluation, camera: str, what: str = "decoded") -> float | None:
    """A camera's mean over the frames where it was measured; None if it was not.

    Args:
        evaluation: of the take.
        camera: its name.
        what: "trained" or "decoded".
    """
    found = [frame.cameras.get(camera, {}).get(f"{MAIN.name}_{what}") for frame in evaluation.frames.values()]
    values = [value for value in found if value is not None]
    return fmean(values) if values else None


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
