"""Settings of the calibration."""

from __future__ import annotations

from typing import ClassVar, Literal

from pydantic import Field

from pipelines.config.section import Section


class BoardSection(Section):
    """The calibration board; `v3studio board` prints one."""

    kind: Literal["charuco", "chessboard"] = "charuco"
    """charuco: squares with markers, parts of it are enough; chessboard: all of it must be in view."""

    columns: int = Field(default=8, ge=3, le=100)
    """Squares in a row; a chessboard of 7 x 4 inner corners has 8 x 5 squares."""

    rows: int = Field(default=5, ge=3, le=100)
    """Rows of squares."""

    square: float = Field(default=0.06, gt=0, lt=10)
    """Side of a square in meters, measured on the print."""

    marker: float = Field(default=0.045, gt=0, lt=10)
    """Side of a marker in meters; ChArUco only."""

    dictionary: str = "DICT_4X4_50"
    """OpenCV's name of the markers' dictionary; ChArUco only."""

    legacy: bool = False
    """The board was drawn by OpenCV before 4.6 (with an even number of rows it begins with a white square)."""

    inverted: bool = False
    """Black and white are exchanged."""


class CalibrateSection(Section):
    """Cameras from the footage or from a board, where none are given."""

    headings: ClassVar[dict[str, str]] = {
        "board_images": "From a board",
        "board_frames": "Finding the board",
        "tie_points": "From points by hand",
        "frame": "From the footage",
        "camera_model": "Lenses",
        "known_cameras": "Known cameras",
        "scale_between": "Scale and floor",
        "focal_factor": "Solver",
    }

    board_images: str = ""
    """Pattern of synchronized footage in which a board is moved about before the cameras, as in board/{camera}.mp4;
    the cameras then come from the board. "" takes them from the capture's own footage."""

    intrinsics_images: str = ""
    """Pattern of pictures of the board of each camera on its own, for the lenses: lenses/{camera}/*_{frame}.jpg."""

    board: BoardSection = BoardSection()
    """What the board is like."""

    board_frames: int = Field(default=300, ge=1)
    """Most frames a camera in which the board is looked for; they are spread over the footage."""

    board_origin: int | None = None
    """Frame of board_images whose board gives the origin, x along its columns, and up; null takes the point that the
    cameras look at, and the cameras' up. Meters in any case."""

    board_upright: bool = False
    """In board_origin's frame the board stands upright, instead of lying on the floor."""

    tie_points: str = ""
    """File of points that were marked by hand in several cameras (docs/CALIBRATION.md shows one), relative to
    capture.root; the cameras then come from these. For cameras that see too little in common to find it themselves."""

    tie_accuracy: float = Field(default=1.0, gt=0, le=100)
    """How exactly tie points were marked, in pixels."""

    tie_world_accuracy: float = Field(default=0.01, gt=0, le=10)
    """How exactly places in the world of tie points were measured, in meters."""

    frame: int | None = None
    """Frame to calibrate from, in the numbers that the files have; null is the first that is used."""

    frames: int = Field(default=1, ge=1, le=100)
    """How many moments, spread over the frames that are used, are taken together; the cameras stand still meanwhile.
    Each takes as long as the first and makes the cameras surer: noise averages out, the performer is elsewhere."""

    look_at: Literal["everything", "room", "performer"] = "everything"
    """Where features are looked for: room leaves the performer out, performer leaves the room out; both need masks."""

    camera_model: Literal["SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "FULL_OPENCV"] = (
        "SIMPLE_RADIAL"
    )
    """COLMAP's model of the lenses: more terms follow stronger distortion and need more features."""

    shared_intrinsics: bool | None = None
    """All cameras have one lens in common (one camera carried about, or lenses locked alike); false: each has its own;
    null: the footage decides (one lens where it fits as well as a lens each; the report says so)."""

    intrinsics_groups: tuple[tuple[str, ...], ...] = ()
    """Names of cameras that have one lens in common, a list a group, as in [[cam01, cam02], [cam03, cam04]]."""

    known_cameras: str = ""
    """Camera file whose lenses are known, relative to capture.root; with known_poses its cameras' places are, too."""

    fix_intrinsics: bool = True
    """Lenses of known_cameras (or of intrinsics_images) are kept; false begins with them and refines them."""

    known_poses: bool = False
    """known_cameras is an older solution of this rig: the new footage is put into it, which takes a fraction of the
    time."""

    fix_poses: bool = False
    """With known_poses: the cameras stay where they are; false follows cameras that were touched since."""

    scale_between: tuple[str, ...] = ()
    """Two cameras whose distance is known, as in [cam01, cam05]; it gives the scale."""

    scale_distance: float | None = Field(default=None, gt=0)
    """Meters between the centers of the two cameras of scale_between."""

    floor: bool = False
    """Look for the floor among the sparse points: it gives up, and the height 0. Needs a textured floor."""

    focal_factor: float = Field(default=1.2, gt=0, le=100)
    """First guess of the focal lengths, in longer image sides."""

    refine_principal_point: bool = False
    """Estimate the principal points too; needs many well spread features."""

    max_features: int = Field(default=8192, ge=100)
    """Most features a camera."""

    max_image_size: int = Field(default=2400, ge=64)
    """Longer side in pixels above which features are found in a reduced image."""

    guided: bool = False
    """Match again along the epipolar lines: more matches, longer."""

    mapper: Literal["auto", "incremental", "global"] = "auto"
    """How the cameras are put together; auto tries incremental, then weaker demands, then global."""
