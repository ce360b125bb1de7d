"""The fonts of the toolkit's widgets."""

import functools
from pathlib import Path

from open3d.visualization import gui

TEXT_SIZE, TITLE_SIZE = 16, 19  # height of a line of text, as the toolkit draws it, and of a title, at 96 dpi


def use_icons(application: gui.Application, file: Path) -> None:
    """Add icons to the font of widgets. Call before the first window is made. `file`: a TrueType font with the icons in
    place of Cyrillic letters: the code points given to `add_typeface_for_code_points` are lost in Open3D 0.20."""
    font = gui.FontDescription()
    font.add_typeface_for_language(str(file), "ru")
    application.set_font(gui.Application.DEFAULT_FONT_ID, font)


@functools.cache
def title_font(application: gui.Application) -> int:
    """Number of the font of dialogs' titles, as high as the headings of panels are in proportion to their text. Call
    before the first window is made."""
    return int(application.add_font(gui.FontDescription(gui.FontDescription.SANS_SERIF, point_size=TITLE_SIZE)))
