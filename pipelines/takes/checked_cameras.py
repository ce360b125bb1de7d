"""Whether a take's cameras are right, as far as it has been checked, and what refinement changed."""

from dataclasses import dataclass

from pipelines.takes.atomic_files import read_model
from pipelines.takes.stage_files import CameraRefinement, CamerasReport, read_cameras_report
from pipelines.takes.take import Take
from studio.calibration.report import CalibrationReport
from studio.calibration.verdict import RigVerdict

NOT_CHECKED = "The cameras are not checked yet; initialize does that."


@dataclass(frozen=True)
class CheckedCameras:
    """What is known about the cameras of a take."""

    report: CamerasReport | None
    # that of `initialize`, else that of the calibration by its images alone; None: not checked yet
    verdict: RigVerdict | None
    refinement: CameraRefinement | None

    @property
    def sentences(self) -> list[str]:
        """For people: the grade with its reason and the fix, and what refinement gained."""
        if self.report is None:
            return []
        if self.verdict is None:
            found = [NOT_CHECKED]
        else:
            words = f"{self.verdict.grade}: {self.verdict.reason} {self.verdict.fix}"
            found = [f"Cameras {words.strip()}"]
        return found if self.refinement is None else [*found, self.refinement.sentence]


def checked_cameras(take: Take) -> CheckedCameras:
    """Read what is known about the cameras of a take. Raises StudioError: `take.damaged`."""
    report = read_cameras_report(take)
    verdict = report.verdict if isinstance(report, CalibrationReport) else None
    if take.rig_verdict.is_file():
        verdict = read_model(take.rig_verdict, RigVerdict)
    refined = take.camera_refinement
    return CheckedCameras(report, verdict, read_model(refined, CameraRefinement) if refined.is_file() else None)
