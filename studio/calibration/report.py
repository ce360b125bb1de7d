"""Models of a calibration's report, as calibrate/report.json stores it.

The same frozen models write and read it. Only fields that were set are written: the three calibration methods set
different fields.
"""

from typing import Literal

from pydantic import BaseModel, ConfigDict


class _Model(BaseModel):
    model_config = ConfigDict(frozen=True, extra="ignore")


class ErrorStatistics(_Model):
    """Reprojection errors in pixels: mean, median and 95th percentile."""

    mean: float
    median: float
    p95: float


class CameraReport(ErrorStatistics):
    """Reprojection errors and image coverage of one camera."""

    observations: int
    coverage: float  # fraction of the cells of a 4x4 grid over the image with at least one observation, 0 to 1
    coverage_map: list[list[int]]  # observations in each cell of an 8x8 grid over the image, row by row
    focal: float  # horizontal focal length in pixels
    usual_focal: float | None = None
    """Median focal length of the cameras with the same image size, set only if this camera's is far from it."""


class Neighbor(_Model):
    """The nearest other camera."""

    name: str
    distance: float  # distance between the centers in world units
    angle: float  # angle between the two cameras in degrees, as seen from the point that the rig looks at


class RigGeometry(_Model):
    """Arrangement of the cameras."""

    radius: float  # mean distance of the cameras from the point that they look at, in world units
    neighbors: dict[str, Neighbor]  # camera name to its nearest other camera
    triangulation_angle: float = 0.0  # median over all points of the widest angle between two of their rays, in degrees


class SharedIntrinsicsReport(_Model):
    """A test whether shared intrinsics fit a set of cameras as well as separate ones."""

    images: list[str]  # camera names
    shared: bool  # whether they are shared in the result
    misfit: float  # increase of the misfit per parameter removed by sharing; 1 is expected by chance


class CameraMotion(_Model):
    """Difference of a camera's pose from that in an earlier solution."""

    center: float  # distance between the centers, in units of the earlier solution
    degrees: float  # angle between the orientations, in degrees


class TargetReport(_Model):
    """Statistics of a calibration from a target."""

    sync_frames: int
    views: int  # observations of the target used
    views_left_out: int  # observations rejected as outliers
    scale_bias: float | None = None
    """Relative error of distances between triangulated corners (0.001 is 1 mm per meter)."""
    corner_error_mm: float | None = None  # RMS distance of the triangulated corners from the target, in millimeters


class IntrinsicsReport(ErrorStatistics):
    """Reprojection errors of one camera's intrinsics calibration."""

    views: int  # images of the target used


class TiePointReport(_Model):
    """Statistics of one tie point."""

    error: float | None  # mean reprojection error in pixels; None without marks
    cameras: int  # number of cameras with a mark
    off: float | None = None  # distance from its measured position in meters, if it has one


class RejectedMark(_Model):
    """A mark that was rejected as an outlier."""

    point: str
    camera: str
    error: float | None  # reprojection error in pixels; None if the point is behind the camera


class FloorReport(_Model):
    """The floor plane with which the world was aligned."""

    tilt: float  # angle by which the up direction changed, in degrees
    share: float  # fraction of the points on the floor, 0 to 1


class CameraVerdict(_Model):
    """Evidence on one camera."""

    matches: int = 0  # verified matches of its image with others
    fits: float | None = None  # fraction of them that fit the epipolar geometry of the rig; None for too few matches
    mask_error: float | None = None
    """Disagreement of its mask with the volume of the others, 0..2 (see `MaskVerdict`); None if not known."""


class RigVerdict(_Model):
    """Verdict on a rig."""

    grade: Literal["good", "usable", "wrong"]
    reason: str  # one or two sentences
    fix: str = ""
    doubtful: tuple[str, ...] = ()  # cameras that disagree with the others
    blamed: Literal["", "cameras", "masks", "cameras or masks"] = ""  # what is wrong, if something is
    cause: str = ""  # the mistake that explains a wrong rig: the kind of a `Mistake`
    fits: float | None = None  # fraction of all matches that fit; None for too few matches
    touching: float | None = None  # fraction of the masks' tangents that fit; None for too few
    cameras: dict[str, CameraVerdict] = {}


class SolutionReport(_Model):
    """The way in which a solution was reached, and what determines it."""

    mapper: str | None = None  # the attempt that found the solution: incremental, lenient, global, known poses
    features: dict[str, int] = {}  # features per camera
    matches: dict[str, int] = {}  # verified matches per camera
    match_inlier_ratio: float | None = None  # fraction of the verified matches that agree with the solution, 0 to 1
    agree: dict[str, float] = {}  # the same per camera, if its matches were counted
    uncertain_degrees: dict[str, float] = {}  # 1-sigma uncertainty of each camera's orientation, in degrees
    uncertain: dict[str, float] = {}
    """1-sigma uncertainty of each camera's position, as a fraction of the distance to the points."""
    sharing: list[SharedIntrinsicsReport] = []
    aspect: float = 1.0  # height of a pixel divided by its width, of all cameras; 1 unless estimated


class CalibrationReport(SolutionReport):
    """Report of a calibration: errors, the arrangement of cameras and points, and what each method adds."""

    reprojection: ErrorStatistics  # errors over all observations
    points: int
    observations: int
    mean_track_length: float  # mean number of cameras that observe a point
    tracks: dict[str, int]  # track length to number of points
    geometry: RigGeometry
    cameras: dict[str, CameraReport]

    # structure from motion
    sync_frames: int | None = None  # images per camera
    moved: dict[str, CameraMotion] = {}

    # calibration target
    target: TargetReport | None = None

    # tie points
    tie_points: dict[str, TiePointReport] = {}
    left_out: list[RejectedMark] = []
    known_intrinsics: list[str] = []  # cameras with given intrinsics
    metric: bool | None = None  # whether world units are meters

    # added by the calibrate stage
    verdict: RigVerdict | None = None
    """The verdict of matches between the images, found without the cameras; None if they were not asked."""
    source: str | None = None  # footage, board or tie points
    file: str | None = None  # the tie point file
    frames: list[int] = []  # frames that the images are from
    intrinsics: dict[str, IntrinsicsReport] = {}  # cameras with intrinsics from images of a calibration target
    floor: FloorReport | None = None
