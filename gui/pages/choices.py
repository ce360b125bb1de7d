"""The buttons above the view: (key, label, tooltip). An empty key is a gap."""

from v3studio.gui.widgets.modes import Choice

REVIEW_CHOICES: tuple[Choice, ...] = (
    ("footage", "Footage", "Footage of a capture camera, masked (1)"),
    ("trained", "Trained", "Trained Gaussians (2)"),
    ("decoded", "Decoded", "Gaussians decoded from the baked stream (3)"),
    ("other", "Other bake", "Another bake or take to compare with; Bake > Bakes chooses it (4)"),
    ("", "", ""),
    ("side by side", "Side by side", "Up to four sources at once (S); B switches between two"),
    ("wipe", "Wipe", "Wipe against footage or trained; drag the line (W)"),
    ("difference", "Difference", "Difference heat map against footage or trained (D)"),
    ("", "", ""),
    ("scene", "Scene", "Splats with cameras, points, mesh, grid and axes; click a camera to look through it (O)"),
    ("edit", "Edit", "Trim, crop, remove floaters, set axes and scale; can be undone (X)"),
)
SCENE_CHOICES: tuple[Choice, ...] = (
    ("scene", "Done", "Leave the scene and show the take again (O)"),
    ("", "", ""),
    ("trained", "Trained", "Trained Gaussians (2)"),
    ("decoded", "Decoded", "Gaussians decoded from the baked stream (3)"),
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
    "masks": "Darken the background, and outline the masks; again: the images as filmed",
    "evidence": "What each camera alone takes for the performer (light), and how far its mask is from the agreed one",
    "garbage masks": "Draw where the performer never is: click a camera, then the corners of a polygon",
    "cameras": "Camera frustums with their images, and sparse points",
    "coverage": "Directions around the performer, and its surface, by how well the training cameras see them",
    "report": "Reprojection error per camera",
    "points by hand": "Mark tie points manually, for footage with too few automatic matches",
    "mesh": "Visual hull of the group's keyframe",
    "points": "Initial points for training",
    "progress": "Live loss, PSNR and splat count; latest render of a held-out camera next to its footage",
    "camera colors": "Each camera's image as filmed and in the mean camera's colors, if 'camera colors' is set",
    "bytes": "Size by attribute and by group",
    "try other QPs": "Size and PSNR at other quantization parameters, measured on a whole group",
}
