"""The icons of buttons."""

from __future__ import annotations

from PIL import Image, ImageDraw, ImageFont

from gui.drawing.icons import CODES, FONT, ICONS, icon
from gui.pages.choices import REVIEW_CHOICES, SCENE_CHOICES, TOOLTIPS
from gui.pages.review.tools import EDIT_CHOICES


def drawn(character: str) -> bytes:
    font = ImageFont.truetype(str(FONT), 32)
    image = Image.new("L", (64, 64))
    ImageDraw.Draw(image).text((8, 8), character, fill=255, font=font)
    return image.tobytes()


def test_every_icon_is_in_the_font_and_looks_different() -> None:
    missing = drawn("\u2603")
    pictures = {name: drawn(chr(code)) for name, code in CODES.items()}
    assert missing not in pictures.values()
    assert all(any(picture) for picture in pictures.values())
    assert len(set(pictures.values())) == len(CODES)


def test_every_button_above_the_view_has_an_icon() -> None:
    keys = {key for key, _, _ in (*REVIEW_CHOICES, *SCENE_CHOICES, *EDIT_CHOICES) if key} | set(TOOLTIPS)
    assert keys <= set(ICONS)
    assert icon("no such button") == ""
