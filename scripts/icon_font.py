"""Makes gui/icons/icons.ttf: the icons of `gui.drawing.icons` from Lucide's font.

    npm pack lucide-static && tar xzf lucide-static-*.tgz
    python scripts/icon_font.py package/font

The glyphs are moved down to the middle of the capitals of the window's font, since the toolkit puts all fonts on one
baseline.
"""

import json
import sys
from pathlib import Path

from fontTools.subset import Options, Subsetter
from fontTools.ttLib import TTFont
from fontTools.ttLib.scaleUpem import scale_upem
from fontTools.ttLib.tables._g_l_y_f import GlyphCoordinates

from v3studio.gui.drawing.icons import CODES, FONT, ICON_SIZE

UNITS = 1000
ASCENT, DESCENT = 928, -244
"""Measures of Roboto, in 1000 units of its em: the toolkit scales each font so that ascent plus descent fill the
line."""

CAPITALS = 711  # height of Roboto's capitals
SIDE = round(UNITS * ICON_SIZE)  # size of the icons' square


def main(folder: Path) -> None:
    """Write the font from the folder of lucide-static, with lucide.ttf and codepoints.json."""
    known = json.loads((folder / "codepoints.json").read_text(encoding="utf-8"))
    missing = CODES.keys() - known.keys()
    if missing:
        sys.exit(f"{folder}: no icons {', '.join(sorted(missing))}")
    font = TTFont(folder / "lucide.ttf")
    options = Options()
    options.drop_tables += ["GSUB"]
    options.name_IDs = ["*"]
    options.hinting = False
    subsetter = Subsetter(options)
    subsetter.populate(unicodes=[known[name] for name in CODES])
    subsetter.subset(font)
    scale_upem(font, UNITS)
    for table in font["cmap"].tables:
        table.cmap = {code: table.cmap[known[name]] for name, code in CODES.items()}
    glyphs, widths = font["glyf"], font["hmtx"]
    down = round((CAPITALS - SIDE) / 2)
    for name in font.getGlyphOrder():
        glyph = glyphs[name]
        if not glyph.numberOfContours:
            continue
        advance, _ = widths[name]
        coordinates, _, _ = glyph.getCoordinates(glyphs)
        share = SIDE / advance
        moved = [(round(x * share), round((y - font["hhea"].descent) * share + down)) for x, y in coordinates]
        glyph.coordinates = GlyphCoordinates(moved)
        glyph.recalcBounds(glyphs)
        widths[name] = (SIDE, glyph.xMin)
    font["hhea"].ascent, font["hhea"].descent, font["hhea"].lineGap = ASCENT, DESCENT, 0
    font["OS/2"].sTypoAscender, font["OS/2"].sTypoDescender, font["OS/2"].sTypoLineGap = ASCENT, DESCENT, 0
    font["OS/2"].usWinAscent, font["OS/2"].usWinDescent = ASCENT, -DESCENT
    FONT.parent.mkdir(exist_ok=True)
    font.save(FONT)
    print(f"{FONT}: {len(CODES)} icons, {FONT.stat().st_size} bytes")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
