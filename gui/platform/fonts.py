"""The fonts of the toolkit's widgets."""

from __future__ import annotations

from pathlib import Path

from open3d.visualization import gui


def use_icons(application: gui.Application, file: Path) -> None:
    """Add icons to the font of widgets. Call before the first window is made.

    Args:
        application: the toolkit's.
        file: a TrueType font with the icons in place of Cyrillic letters: the code points given to
            `add_typeface_for_code_points` are lost in Open3D 0.20.
    """
    font = gui.FontDescription()
    font.add_typeface_for_language(str(file), "ru")
    application.set_font(gui.Application.DEFAULT_FONT_ID, font)
