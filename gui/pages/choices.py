"""The buttons above the view: (key, label, tooltip). An empty key is a gap."""

from enum import StrEnum

from v3studio.gui.drawing.compare import Mode, What
from v3studio.gui.widgets.modes import Choice


class ViewMode(StrEnum):
    """What the view of a stage shows."""

    AS_FILMED = ""
    MASKS = "masks"
    EVIDENCE = "evidence"
    GARBAGE = "garbage masks"
    CAMERAS = "cameras"
    COVERAGE = "coverage"
    REPORT = "report"
    BY_HAND = "points by hand"
    MESH = "mesh"
    POINTS = "points"
    PROGRESS = "progress"
    CAMERA_COLORS = "camera colors"
    BYTES = "bytes"
    OTHER_QPS = "try other QPs"


REVIEW_CHOICES: tuple[Choice, ...] = (
    (What.FOOTAGE, "Footage", "Footage of a capture camera, masked (1)"),
    (What.TRAINED, "Trained", "Trained Gaussians (2)"),
    (What.DECODED, "Decoded", "Gaussians decoded from the baked stream (3)"),
    (What.OTHER, "Other bake", "Another bake or take to compare with; Bake > Bakes chooses it (4)"),
    ("", "", ""),
    (Mode.SIDE_BY_SIDE, "Side by side", "Up to four sources at once (S); B switches between two"),
    (Mode.WIPE, "Wipe", "Wipe against footage or trained; drag the line (W)"),
    (Mode.DIFFERENCE, "Difference", "Difference heat map against footage or trained (D)"),
    ("", "", ""),
    (Mode.SCENE, "Scene", "Splats with cameras, points, mesh, grid and axes; click a camera to look through it (O)"),
    ("edit", "Edit", "Trim, crop, remove floaters, set axes and scale; can be undone (X)"),
)
SCENE_CHOICES: tuple[Choice, ...] = (
    (Mode.SCENE, "Done", "Leave the scene and show the take again (O)"),
    ("", "", ""),
    (What.TRAINED, "Trained", "Trained Gaussians (2)"),
    (What.DECODED, "Decoded", "Gaussians decoded from the baked stream (3)"),
    ("", "", ""),
    ("splats", "Splats", "The frame's splats"),
    ("cameras", "Cameras", "Frusta of the capture cameras with their images; click one to look through it"),
    ("points", "Points", "Sparse points of the calibration, else the initial points of training"),
    ("mesh", "Mesh", "Visual hull of the group's keyframe"),
    ("grid", "Grid", "A grid on the ground"),
    ("axes", "Axes", "The axes of the world: x red, y green, z blue"),
    ("volume", "Volume", "The box around the visual hull, and its size"),
)

DIALOGS = {  # label and tooltip of the buttons that open a dialog, by page and key
    ("capture", "cameras"): ("Cameras...", "Which cameras are used, and which are held out"),
    ("bake", "bakes"): ("Bakes...", "Bakes that the take keeps: compare, keep another one"),
}

TOOLTIPS = {
    ViewMode.MASKS: "Darken the background, and outline the masks; again: the images as filmed",
    ViewMode.EVIDENCE: "What each camera alone takes for the performer (light), and how far its mask is off",
    ViewMode.GARBAGE: "Draw where the performer never is: click a camera, then the corners of a polygon",
    ViewMode.CAMERAS: "Camera frustums with their images, and sparse points",
    ViewMode.COVERAGE: "Directions around the performer, and its surface, by how well the training cameras see them",
    ViewMode.REPORT: "Reprojection error per camera",
    ViewMode.BY_HAND: "Mark tie points manually, for footage with too few automatic matches",
    ViewMode.MESH: "Visual hull of the group's keyframe",
    ViewMode.POINTS: "Initial points for training",
    ViewMode.PROGRESS: "Live loss, PSNR and splat count; latest render of a held-out camera next to its footage",
    ViewMode.CAMERA_COLORS: "Each camera's image as filmed and in the mean camera's colors, if 'camera colors' is set",
    ViewMode.BYTES: "Size by attribute and by group",
    ViewMode.OTHER_QPS: "Size and PSNR at other quantization parameters, measured on a whole group",
}
