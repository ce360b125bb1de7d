from PIL import Image, ImageDraw, ImageFont

from v3studio.gui.drawing.icons import CODES, FONT


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
    assert drawn(chr(max(CODES.values()) + 1)) == missing, "the font was made of other icons; see scripts/icon_font.py"
