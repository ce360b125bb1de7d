"""The buttons above the view: (key, label, tooltip). An empty key is a gap."""

from enum import StrEnum
from typing import Self

from v3studio.gui.drawing.compare import Mode, What
from v3studio.gui.widgets.modes import Choice


class Button(StrEnum):
    """The key of a button, with its tooltip, and what the view says while it is pressed."""

    tooltip: str
    hint: str

    def __new__(cls, value: str, tooltip: str = "", hint: str = "") -> Self:
        button = str.__new__(cls, value)
        button._value_, button.tooltip, button.hint = value, tooltip, hint
        return button


class ViewMode(Button):
    """The images that the views of stages show."""

    AS_FILMED = ""
    MASKS = "masks", "Darken the background, and outline the masks; again: the images as filmed"
    EVIDENCE = "evidence", "What each camera alone takes for the performer (light), and how far its mask is off"
    GARBAGE = "garbage masks", "Draw where the performer never is: click a camera, then the corners of a polygon"
    CORRECT = "correct", "Correct a mask: click a camera, then the performer, or with the right button what is not"
    CARD = "card", "Are time, cameras, masks and color right? Measured before training, and by Check"
    CAMERAS = "cameras", "Camera frustums with their images, and sparse points"
    COVERAGE = "coverage", "Directions around the performer, and its surface, by how well the training cameras see them"
    REPORT = "report", "Reprojection error per camera"
    BY_HAND = "points by hand", "Mark tie points manually, for footage with too few automatic matches"
    MESH = "mesh", "Visual hull of the group's keyframe"
    POINTS = "points", "Initial points for training"
    PROGRESS = "progress", "Live loss, PSNR and splat count; latest render of a held-out camera next to its footage"
    CAMERA_COLORS = "camera colors", "Each camera's image as filmed, and in the mean camera's colors"
    BYTES = "bytes", "Size by attribute and by group"
    OTHER_QPS = "try other QPs", "Size and PSNR at other quantization parameters, measured on a whole group"


REVIEW_CHOICES: tuple[Choice, ...] = (
    (What.FOOTAGE, "Footage", "Footage of a capture camera (1)"),
    (What.TRAINED, "Trained", "Trained Gaussians (2)"),
    (What.DECODED, "Decoded", "Gaussians decoded from the baked stream (3)"),
    (What.OTHER, "Other bake", "Another bake or take to compare with; Bake > Bakes chooses it (4)"),
    ("", "", ""),
    (Mode.SIDE_BY_SIDE, "Side by side", "Up to four sources at once (S); B switches between two"),
    (Mode.WIPE, "Wipe", "Wipe against footage or trained; drag the line (W)"),
    (Mode.DIFFERENCE, "Difference", "Difference heat map against the uncut footage or trained (D)"),
    ("", "", ""),
    (Mode.SCENE, "Scene", "Splats with cameras, points, mesh, grid and axes; click a camera to look through it (O)"),
    ("set", "Set", "The set behind the performer, in Review and in the scene"),
    ("edit", "Edit", "Trim, crop, remove floaters, set axes and scale; can be undone (X)"),
)
SCENE_CHOICES: tuple[Choice, ...] = (
    (Mode.SCENE, "Done", "Leave the scene and show the take again (O)"),
    ("", "", ""),
    (What.TRAINED, "Trained", "Trained Gaussians (2)"),
    (What.DECODED, "Decoded", "Gaussians decoded from the baked stream (3)"),
    ("", "", ""),
    ("splats", "Splats", "The frame's splats"),
    ("set", "Set", "The splats of the set, behind those of the performer"),
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
