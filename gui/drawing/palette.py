"""The window's colors: dark, calm, one accent. 8-bit sRGB."""

from enum import StrEnum

RGB = tuple[int, int, int]

BLACK: RGB = (8, 9, 10)  # outline of text and marks over images
GROUND: RGB = (30, 32, 36)  # background of the window
PANEL: RGB = (37, 40, 45)  # background of panels
RAISED: RGB = (49, 53, 60)  # the selected row, tracks, borders of images
LINE: RGB = (60, 65, 73)  # thin lines and grids
DIALOG: RGB = (45, 45, 45)  # background of dialogs, as the toolkit draws it
BORDER: RGB = (128, 128, 128)  # border of buttons, as the toolkit draws it

TEXT: RGB = (222, 226, 232)
DIM: RGB = (152, 160, 171)
FAINT: RGB = (92, 99, 110)  # not for text, as it lacks contrast, except that of buttons which cannot be pressed
ACCENT: RGB = (86, 190, 222)  # the accent: selection, running stages, the playhead, decoded splats

ACCENT_DARK: RGB = (40, 92, 112)

HELD_OUT: RGB = ACCENT  # cameras that are not trained on, in Capture, Calibrate and the scene
SECOND: RGB = (188, 193, 201)  # the second curve of a pair

GOOD: RGB = (120, 184, 132)
FAIR: RGB = (222, 178, 92)
BAD: RGB = (234, 132, 124)

SERIES: tuple[RGB, ...] = (  # of curves in one plot, in order; they repeat
    SECOND,
    ACCENT,
    (242, 164, 104),
    (160, 204, 120),
    (214, 150, 222),
    (232, 200, 96),
    (126, 168, 240),
    (240, 144, 154),
)


class State(StrEnum):
    """Progress of a stage, a take of the queue, or a recent take."""

    DONE = "done"
    PARTIAL = "partial"
    STALE = "stale"
    FAILED = "failed"
    MISSING = "missing"
    RUNNING = "running"
    WAITING = "waiting"


STATE_COLORS = dict(zip(State, (GOOD, FAIR, FAIR, BAD, FAINT, ACCENT, ACCENT_DARK), strict=True))

AXES: tuple[RGB, RGB, RGB] = (BAD, GOOD, (110, 150, 235))  # colors of the x, y and z axes
