"""Printable calibration targets: a vector PDF at true scale."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np

from v3studio.studio.atomic_files import atomic_path
from v3studio.studio.calibration.target.pattern import CalibrationTarget
from v3studio.studio.errors import StudioError
from v3studio.studio.process import plot_style

PAPERS = {  # millimeters, portrait
    "a4": (210.0, 297.0),
    "a3": (297.0, 420.0),
    "a2": (420.0, 594.0),
    "a1": (594.0, 841.0),
    "a0": (841.0, 1189.0),
    "letter": (215.9, 279.4),
    "tabloid": (279.4, 431.8),
}
_EDGE = 8.0  # unprintable margin in millimeters
_TEXT = 9.0  # millimeters for the ruler and text below the target


@plot_style(pdf_compression=6)
def write_target_pdf(target: CalibrationTarget, path: Path | str, *, paper: str = "fit") -> tuple[float, float]:
    """Write a target as a PDF, atomically; returns width and height of the page in millimeters.

    Args:
        paper: "fit" for a page of the target's size with a margin of one square, or a key of `PAPERS`; the orientation
            (portrait or landscape) is chosen so that the target fits.

    Raises:
        StudioError: the paper is unknown (target.paper), the target does not fit on it (target.too_large), or the file
            cannot be written (target.unwritable).
    """
    path = Path(path)
    from matplotlib.backends.backend_pdf import FigureCanvasPdf
    from matplotlib.collections import PolyCollection
    from matplotlib.figure import Figure

    width, height = _page(target, paper)
    figure = Figure(figsize=(width / 25.4, height / 25.4))
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set(xlim=(0, width), ylim=(height, 0))  # millimeters from the upper left corner
    axes.axis("off")
    across, down = target.columns * target.square * 1000, target.rows * target.square * 1000
    left, top = (width - across) / 2, (height - _TEXT - down) / 2
    black = [np.array([(x, y), (x + w, y), (x + w, y + h), (x, y + h)]) for x, y, w, h in dark(target)]
    corners = [1000 * rectangle + (left, top) for rectangle in black]
    axes.add_collection(PolyCollection(corners, facecolors="black", edgecolors="none", antialiaseds=False))
    _foot(axes, target, left, height)
    # no date or host name in the file: the same target gives the same bytes
    about = {"Title": describe(target), "Creator": "V3 Studio", "Producer": None, "CreationDate": None}
    try:
        with atomic_path(path) as temporary:
            FigureCanvasPdf(figure).print_pdf(str(temporary), metadata=about)
    except OSError as error:
        fix = "Check the free space and permissions."
        raise StudioError("target.unwritable", f"cannot be written ({error.strerror})", file=path, fix=fix) from None
    return width, height


def describe(target: CalibrationTarget) -> str:
    """One-line description of a target."""
    base = f"{target.kind}, {target.columns} x {target.rows} squares of {target.square * 1000:g} mm"
    if target.kind == "charuco":
        base += f", markers {target.marker * 1000:g} mm, {target.dictionary}" + (", legacy" if target.legacy else "")
    return base


def dark(target: CalibrationTarget) -> list[tuple[float, float, float, float]]:
    """Black areas: rectangles x, y, width, height in meters, target coordinates.

    The black cells of markers are merged into horizontal runs.
    """
    s = target.square
    if target.kind == "chessboard":
        # as in OpenCV's pattern the first square is black
        return [(i * s, j * s, s, s) for j in range(target.rows) for i in range(target.columns) if (i + j) % 2 == 0]
    charuco = target.charuco
    dictionary = charuco.getDictionary()
    cells = dictionary.markerSize + 2  # a border of one cell
    rectangles: list[tuple[float, float, float, float]] = []
    with_marker = set()
    for number, corners in zip(np.ravel(charuco.getIds()), charuco.getObjPoints(), strict=True):
        x0, y0 = np.asarray(corners)[0, :2].astype(float)
        with_marker.add((int(x0 / s), int(y0 / s)))
        picture = cv2.aruco.generateImageMarker(dictionary, int(number), cells)
        size = target.marker / cells
        for row in range(cells):
            column = 0
            while column < cells:  # one rectangle per run of black cells
                end = column
                while end < cells and picture[row, end] < 128:
                    end += 1
                if end > column:
                    rectangles.append((x0 + column * size, y0 + row * size, (end - column) * size, size))
                column = end + 1
    rectangles += [
        (i * s, j * s, s, s) for j in range(target.rows) for i in range(target.columns) if (i, j) not in with_marker
    ]
    return rectangles


def _page(target: CalibrationTarget, paper: str) -> tuple[float, float]:
    width, height = target.columns * target.square * 1000, target.rows * target.square * 1000
    if paper == "fit":
        white = max(_EDGE, target.square * 1000)
        return width + 2 * white, height + 2 * white + _TEXT
    if paper not in PAPERS:
        problem = f"unknown paper '{paper}', expected fit or one of {', '.join(PAPERS)}"
        raise StudioError("target.paper", problem, value=paper, expected=["fit", *PAPERS])
    sizes = [PAPERS[paper], PAPERS[paper][::-1]]
    if width > height:
        sizes.reverse()
    for page in sizes:
        if width + 2 * _EDGE <= page[0] and height + 2 * _EDGE + _TEXT <= page[1]:
            return page
    problem = f"the target is {width:g} x {height:g} mm and does not fit on {paper}"
    fix = "Use smaller squares, fewer squares or larger paper."
    raise StudioError("target.too_large", problem, value=[width, height], fix=fix, paper=paper)


def _foot(axes: Any, target: CalibrationTarget, left: float, height: float) -> None:
    """A ruler to check the print, and the description of the target."""
    left, y = max(left, _EDGE), height - _EDGE / 2 - 2
    length = 50.0
    gray = "0.35"
    axes.plot([left, left + length], [y, y], color=gray, linewidth=0.6)
    for at in range(0, int(length) + 1, 10):
        axes.plot([left + at, left + at], [y - 1.5, y], color=gray, linewidth=0.6)
    text = f"50 mm; print at 100%, then measure. {describe(target)}"
    axes.text(left + length + 3, y, text, fontsize=5, color=gray, verticalalignment="bottom")
