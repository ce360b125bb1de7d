"""Size and density of the X screen, queried before the window is created."""

import re
from contextlib import closing

from v3studio.gui.platform.x_window import XDisplay

USUAL_DPI = 96.0
SHARE = 0.95  # largest share of the screen that a window takes on each axis


def fitting_size(size: tuple[int, int]) -> tuple[int, int]:
    """Window size in pixels for `size` at 96 dpi: larger on dense screens, where the toolkit scales its font but not
    its windows; at most `SHARE` of the screen."""
    screen = current_screen()
    if screen is None:
        return size
    width, height, resources = screen
    scale = scale_of(resources)
    return (
        min(round(size[0] * scale), max(round(width * SHARE), size[0])),
        min(round(size[1] * scale), max(round(height * SHARE), size[1])),
    )


def scale_of(resources: str) -> float:
    """Font scale relative to 96 dpi, from the X resources (`Xft.dpi`); at least 1."""
    match = re.search(r"^Xft\.dpi:\s*([0-9]+\.?[0-9]*)\s*$", resources, re.MULTILINE)
    return max(float(match[1]) / USUAL_DPI, 1.0) if match else 1.0


def current_screen() -> tuple[int, int, str] | None:
    with closing(XDisplay()) as display:
        return display.screen
