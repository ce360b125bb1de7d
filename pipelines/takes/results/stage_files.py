"""The small JSON files that stages write beside their results, the calibration report, and what is known of cameras."""

from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

from pydantic import Field, JsonValue

from v3studio.pipelines.takes.files.json_files import Result, read_json, read_model, validated
from v3studio.pipelines.takes.take import Take
from v3studio.studio.calibration.report import CalibrationReport, RigVerdict
from v3studio.studio.card.grades import Card


class InitialPointsReport(Result):
    """initialize/group_NNN/report.json."""

    key: str = ""  # digest of everything that the points were made from
    keyframe: int  # frame number in the footage
    points: int
    vertices: int
    faces: int

    disagreement: dict[str, float] = Field(default_factory=dict)
    """Fraction of a camera's mask, by its name, that the visual hull does not reproduce."""

    warnings: tuple[Any, ...] = ()
    files: dict[str, str] = Field(default_factory=dict)  # digests of the files in the folder, by name


class SetReport(Result):
    """set/set.json."""

    reason: str = ""  # why there is no set, a sentence; "" if there is one
    splats: int = 0
    psnr: dict[str, float] = Field(default_factory=dict)  # against the plates, where they are reliable, dB by camera

    colors: dict[str, tuple[tuple[float, float, float, float], ...]] = Field(default_factory=dict)
    """A training camera's 3x4 matrix from the splats' colors to its own, as in `CameraColors`."""


class TrainedGroup(Result):
    """train/group_NNN/group.json."""

    group: int
    first: int  # index in the take of the first frame, counted from 0
    frames: tuple[int, ...]  # frame numbers in the footage
    splats: int
    sh_degree: int

    outlines_off: float | None = None
    """Percent of the masks' outlines that the keyframe's splats disagree with; None: not measured."""

    seconds: tuple[float, ...] = ()  # training time of each frame; 0 where unknown
    joint_seconds: float = 0.0  # time of joint training, which all frames share


class CameraColors(Result):
    """train/camera_colors.json: color differences between the cameras of a take."""

    key: str  # digest of everything that the matrices were fitted from
    frame: int  # frame number in the footage to which they were fitted

    cameras: dict[str, tuple[tuple[float, float, float, float], ...]]
    """A training camera's 3x4 matrix from the splats' colors (RGB 0 to 1, and 1) to those of the camera. The mean of
    all cameras changes nothing."""

    def off_on_gray(self, camera: str) -> float:
        """The difference of a middle gray between a camera and the mean camera: the largest difference of a
        channel, in levels of 255."""
        return 255 * max(abs(sum(row[:3]) / 2 + row[3] - 0.5) for row in self.cameras[camera])


class CameraChange(Result):
    """The change of a camera by refinement."""

    degrees: float  # angle between the orientations
    distance: float  # between the centers, in units of the calibration
    focal: float  # change of the horizontal focal length, pixels of the training images
    principal_point: float  # distance between the principal points, pixels of the training images
    radial: float  # change of the first radial term (OpenCV's k1)


class CameraRefinement(Result):
    """train/refinement.json: cameras refined together with the splats of a keyframe."""

    key: str  # digest of everything that they were refined from
    frame: int  # frame number in the footage
    used: bool  # whether the refined cameras are used: they fit better than the calibrated ones
    before: float  # mean PSNR in dB of pixels of the training views that were held back, with the calibrated cameras
    after: float  # the same after equally many steps with refined cameras

    held_out_calibrated: float | None = None
    """PSNR of the held-out views in dB with the calibrated cameras, all of them; None without held-out views."""

    held_out_before: float | None = None  # the same with the held-out cameras aligned to the splats

    held_out_after: float | None = None
    """PSNR of the held-out views with refined training cameras, and the held-out cameras aligned to the splats."""

    cameras: dict[str, CameraChange] = Field(default_factory=dict)

    @property
    def sentence(self) -> str:
        """Say what was gained, and whether it is used."""
        gain = f"{self.after - self.before:+.2f} dB on pixels held back ({self.before:.2f} to {self.after:.2f})"
        if self.held_out_before is not None and self.held_out_after is not None:
            gain += f", {self.held_out_after - self.held_out_before:+.2f} dB on held-out ones"
        if not self.used:
            return f"Refining the cameras does not help: {gain}. The calibrated cameras are used."
        return f"Refined cameras: {gain}."


class BakedGroupNote(Result):
    """.v3studio/work/bake/group_NNN.json: what a baked group was made from."""

    key: str
    files: dict[str, int]  # sizes in bytes by path in the stream
    digests: dict[str, str]  # by file name
    entry: dict[str, JsonValue]  # the group's entry in manifest.json
    smoothed: bool = True  # False: its level is out of reach with smooth paths, so they are left as they are

    seen: tuple[tuple[float, float, float], tuple[float, float, float]] | None = None
    """Least and greatest corner of the box of what one sees, world units; None: not known, or nothing can be seen."""


class StoredCard(Card):
    """initialize/card.json."""

    key: str = ""  # digest of cameras, images and masks


class FoundMotion(Result):
    """initialize/motion.json: how far the performer moves, which decides where groups begin."""

    key: str = ""  # digest of everything that the motion was found from
    frames: tuple[int, ...] = ()
    motion: tuple[float, ...] = ()
    """Motion from each frame to the next, in sizes of the performer: see `studio.footage.motion`."""

    cameras: tuple[str, ...] = ()


class CamerasFromFile(Result):
    """The report if the cameras are from a calibration file."""

    source: Literal["file"] = "file"
    file: str  # the calibration file
    notes: tuple[str, ...] = ()  # what its reader assumed or left out, one sentence each


CamerasReport: TypeAlias = CalibrationReport | CamerasFromFile


def read_cameras_report(take: Take) -> CamerasReport | None:
    """The take's calibration report; None if there is none. Raises StudioError: `take.damaged`."""
    path = take.calibration_report
    if not path.is_file():
        return None
    content = read_json(path)
    if isinstance(content, dict) and "reprojection" in content:
        return validated(path, content, CalibrationReport)
    return validated(path, content, CamerasFromFile)


def cameras_source(take: Take) -> str | None:
    """The source of the calibrated cameras: "file", "board", "tie points" or "footage"; None if it has not run.
    Raises StudioError: `take.damaged`."""
    path = take.calibration_report
    report = read_json(path) if path.is_file() else None
    source = report.get("source") if isinstance(report, dict) else None
    return source if isinstance(source, str) else None


NOT_CHECKED = "The cameras are not checked yet; initialize does that."


@dataclass(frozen=True)
class CheckedCameras:
    """Knowledge about the cameras of a take."""

    report: CamerasReport | None
    # that of `initialize`, else that of the calibration by its images alone; None: not checked yet
    verdict: RigVerdict | None
    refinement: CameraRefinement | None

    @property
    def sentences(self) -> list[str]:
        """Sentences for people: the grade with its reason and the fix, and what refinement gained."""
        if self.report is None:
            return []
        if self.verdict is None:
            graded = [NOT_CHECKED]
        else:
            words = f"{self.verdict.grade}: {self.verdict.reason} {self.verdict.fix}"
            graded = [f"Cameras {words.strip()}"]
        return graded if self.refinement is None else [*graded, self.refinement.sentence]


def checked_cameras(take: Take) -> CheckedCameras:
    """Read what is known about the cameras of a take. Raises StudioError: `take.damaged`."""
    report = read_cameras_report(take)
    verdict = report.verdict if isinstance(report, CalibrationReport) else None
    if take.rig_verdict.is_file():
        verdict = read_model(take.rig_verdict, RigVerdict)
    refined = take.camera_refinement
    return CheckedCameras(report, verdict, read_model(refined, CameraRefinement) if refined.is_file() else None)
