"""The card as an image: each camera with the outline of its mask, and the hull of the others' masks or their points."""

import textwrap

import cv2
import numpy as np

from v3studio.studio.cameras import FootageView
from v3studio.studio.card.card import Measured
from v3studio.studio.errors import StudioError
from v3studio.studio.meshing.agreement import common_points
from v3studio.studio.meshing.silhouettes import silhouettes

_WIDTH, _HEIGHT, _BELOW = 320, 180, 22  # of a thumbnail, and of its name
_MASK, _HULL, _TEXT, _GROUND = (255, 180, 0), (0, 220, 255), (235, 235, 235), (24, 24, 24)
_GRADES = {"good": (90, 200, 90), "doubtful": (240, 180, 40), "wrong": (240, 80, 70)}
_LINE, _COLUMNS = 22, 6
_PIXELS = 60_000  # of masks, for the hull


def draw(measured: Measured) -> np.ndarray:
    """(H, W, 3) uint8 RGB. Masks are orange; the outline of what the cameras agree on, or lines' ends of matches with
    other cameras where there are no masks, is blue."""
    sample, card = measured.sample, measured.card
    names = list(sample.images)
    columns = min(_COLUMNS, max(2, int(np.ceil(np.sqrt(len(names))))))
    width = max(columns * _WIDTH, 3 * _WIDTH)
    rows = -(-len(names) // columns)
    lines = [
        (text, _GRADES.get(check.grade, (170, 170, 170)))
        for check in card.checks
        for text in textwrap.wrap(check.line, width // 9)
    ]
    top = _LINE * len(lines) + 16
    canvas = np.full((top + rows * (_HEIGHT + _BELOW), width, 3), _GROUND, np.uint8)
    for number, (text, color) in enumerate(lines):
        cv2.putText(canvas, text, (10, 22 + _LINE * number), cv2.FONT_HERSHEY_SIMPLEX, 0.5, color, 1, cv2.LINE_AA)
    hull = _hull(measured)
    for number, name in enumerate(names):
        x, y = number % columns * _WIDTH, top + number // columns * (_HEIGHT + _BELOW)
        small = _thumbnail(measured, name, hull)
        canvas[y : y + small.shape[0], x : x + small.shape[1]] = small
        late = f"  {card.late[name]:+.2f} frames" if name in card.late else ""
        off = next((check.grade for check in card.checks if name in check.cameras), "")
        at = (x + 4, y + _HEIGHT + 15)
        text = f"{name}{late}"
        cv2.putText(canvas, text, at, cv2.FONT_HERSHEY_SIMPLEX, 0.45, _GRADES.get(off, _TEXT), 1, cv2.LINE_AA)
    return canvas


def _hull(measured: Measured) -> np.ndarray | None:
    """(N, 3) points of what most cameras have in their masks; None: nothing, or no cameras."""
    sample, cameras = measured.sample, measured.cameras
    views = [
        FootageView(cameras[name], sample.images[name], mask)
        for name, mask in sample.shown_masks.items()
        if name in cameras
    ]
    if len(views) < 2:
        return None
    try:
        return common_points(silhouettes(views, max_pixels=_PIXELS * len(views)), max(2, len(views) // 3))
    except StudioError:  # all masks are empty
        return None


def _thumbnail(measured: Measured, name: str, hull: np.ndarray | None) -> np.ndarray:
    image = measured.sample.images[name]
    factor = min(_WIDTH / image.shape[1], _HEIGHT / image.shape[0])
    size = (max(1, int(factor * image.shape[1])), max(1, int(factor * image.shape[0])))
    small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    if hull is not None and name in measured.cameras:
        pixels, depth = measured.cameras[name].project(hull)
        area = np.zeros(size[::-1], np.uint8)
        at = np.floor(factor * pixels[(depth > 0) & (np.abs(pixels) < 1e5).all(1)]).astype(int)
        at = at[(at >= 0).all(1) & (at < size).all(1)]
        area[at[:, 1], at[:, 0]] = 255
        area = np.asarray(cv2.morphologyEx(area, cv2.MORPH_CLOSE, np.ones((13, 13), np.uint8)), np.uint8)
        _outline(small, area, _HULL)
    else:
        for pair in measured.pairs:
            pixels = {pair.first: pair.first_pixels, pair.second: pair.second_pixels}.get(name, np.zeros((0, 2)))
            for column, row in (factor * pixels[:60]).astype(int).tolist():
                cv2.circle(small, (column, row), 1, _HULL, -1)
    if name in measured.sample.shown_masks:
        _outline(small, cv2.resize(measured.sample.shown_masks[name], size, interpolation=cv2.INTER_AREA), _MASK)
    return small


def _outline(image: np.ndarray, mask: np.ndarray, color: tuple[int, int, int]) -> None:
    contours, _ = cv2.findContours((mask > 127).astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    cv2.drawContours(image, contours, -1, color, 1)
