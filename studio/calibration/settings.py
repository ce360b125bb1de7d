"""Settings of calibration: from the footage, from a calibration target, or from marked tie points."""

from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field, model_validator

from v3studio.studio.calibration.target.pattern import CalibrationTarget
from v3studio.studio.settings import Affects, Conflict, Empty, Heading, Name, Settings, Unbounded

CameraModel = Literal["SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "FULL_OPENCV", "OPENCV_FISHEYE"]
USUAL_MODEL: CameraModel = "SIMPLE_RADIAL"

Meters = Annotated[float, Field(gt=0)]
_FRAME_NUMBER = Unbounded("frame numbers are those of the files")
_ALL_WAYS = Affects("cameras_from_images", "cameras_from_target", "cameras_from_points")
_TARGET = Affects("cameras_from_images", "cameras_from_target")
_POINTS = Affects("cameras_from_images", "cameras_from_points")


class CalibrateSettings(Settings):
    """Calibration of the cameras, for captures without a calibration file.

    Functions of `studio.calibration` take opened footage, a `CalibrationTarget`, observations or tie points, and read
    only their solver options from this model. The caller selects the input (`board_images`, `intrinsics_images`,
    `tie_points`, `frame`, `frame_count`, `look_at`, `known_cameras`, ...).
    """

    affects: ClassVar[Affects | None] = Affects("cameras_from_images")

    board_images: Annotated[Name | None, Heading("Calibration target"), _TARGET, Empty("none")] = None
    """Path pattern of synchronized footage in which a calibration target (board) is moved in front of the cameras;
    example: board/{camera}.mp4. If set, the cameras are calibrated from it. null: from the capture's own footage."""

    intrinsics_images: Annotated[Name | None, _ALL_WAYS, Empty("none")] = None
    """Path pattern of additional images of the target for each camera, used for intrinsics only; example:
    lenses/{camera}/*_{frame}.jpg."""

    board: Annotated[CalibrationTarget, _ALL_WAYS] = CalibrationTarget()
    """Layout and size of the calibration target."""

    board_origin: Annotated[int | None, Heading("Target detection"), _FRAME_NUMBER, _TARGET, Empty("automatic")] = None
    """Frame of board_images in which the target defines the world: origin at its center, x along its rows of squares,
    z up (see board_upright). null: the origin is the point that the cameras look at, and up is the mean of their up
    directions. World units are meters in both cases."""

    board_upright: Annotated[bool, _TARGET] = False
    """true: the target is upright in frame board_origin. false: it lies on the floor."""

    tie_points: Annotated[Name | None, Heading("Tie points"), Empty("none")] = None
    """File of tie points marked manually in several cameras (docs/guides/calibrate-points.md), relative to
    capture.root. If set, the cameras are calibrated from these points. For rigs whose cameras share too few features
    to be matched automatically."""

    frame: Annotated[int | None, Heading("Footage"), _FRAME_NUMBER, Affects(), Empty("automatic")] = None
    """Frame to calibrate from, as numbered in the files. null: as frame_count says."""

    frame_count: Annotated[int | None, Affects(), Empty("as needed")] = Field(default=None, ge=1, le=100)
    """Number of frames, spread over the footage, that are used jointly for calibration; the cameras must not move. Run
    time is proportional to this number. More frames reduce noise and show more of what the performer occludes. null: 1,
    3, 6, 12 or 24, the first with which all cameras are registered with at least 300 points each and matches between
    images do not contradict the rig."""

    look_at: Literal["everything", "room", "performer"] = "everything"
    """Image region in which features are detected. everything: the whole image. room: everything except the performer.
    performer: only the performer. The last two need masks."""

    camera_model: Annotated[CameraModel | None, Heading("Intrinsics"), _ALL_WAYS, Empty("automatic")] = None
    """COLMAP camera model. Models with more distortion parameters fit stronger distortion but need more features. null:
    SIMPLE_RADIAL, but OPENCV_FISHEYE for the cameras whose images of the footage or the target it fits much better."""

    shared_intrinsics: Annotated[bool | None, _POINTS, Empty("automatic")] = None
    """true: all cameras of one image size share intrinsics (one camera moved around, or identical fixed lenses). false:
    intrinsics per camera. null: shared if they fit as well as intrinsics per camera (see the calibration report);
    with tie points: shared."""

    intrinsics_groups: Annotated[tuple[tuple[str, ...], ...], Empty("none")] = ()
    """Groups of cameras that share intrinsics; example: [[cam01, cam02], [cam03, cam04]]."""

    known_cameras: Annotated[Name | None, Heading("Known cameras"), Empty("none")] = None
    """Camera file of these cameras, relative to capture.root. null: none."""

    known: Literal["intrinsics", "initial_intrinsics", "poses", "initial_poses"] = "intrinsics"
    """How known_cameras, and the intrinsics from intrinsics_images, are used. intrinsics: they are kept.
    initial_intrinsics: they are initial values. poses: intrinsics and poses are kept, and the new footage is registered
    to them, which is much faster than a full calibration. initial_poses: the same, but poses are initial values, in
    case cameras have moved since."""

    known_distance: Annotated[
        tuple[Name, Name, Meters] | None, Heading("Scale and floor"), _POINTS, Empty("unknown")
    ] = None
    """Two cameras and the distance between their centers in meters, which sets the scale; example: [cam01, cam05, 4.2].
    null: unknown."""

    floor: bool = False
    """Detect the floor in the sparse points; it defines up and height 0. Needs a textured floor."""

    @model_validator(mode="after")
    def _groups(self) -> Self:
        grouped = [name for group in self.intrinsics_groups for name in group]
        twice = [name for name in grouped if grouped.count(name) > 1]
        if twice:
            raise Conflict(
                f"intrinsics_groups contains camera {twice[0]} twice", "Keep it in one group.", "intrinsics_groups"
            )
        if any(len(group) < 2 for group in self.intrinsics_groups):
            raise Conflict(
                "intrinsics_groups has a group of fewer than two cameras",
                "List all cameras that share intrinsics, or remove the group.",
                "intrinsics_groups",
            )
        return self

    @property
    def has_distortion(self) -> bool:
        """Tell whether the camera model has a radial term."""
        return self.camera_model not in ("SIMPLE_PINHOLE", "PINHOLE")
