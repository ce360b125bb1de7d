"""Images of a ColorChecker Classic, drawn in perspective with known colors."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np

from v3studio.studio.footage.color_chart import REFERENCE

WIDTH, HEIGHT = 640, 480
_PATCH, _GAP = 50, 10


def flat_chart(colors: np.ndarray = REFERENCE) -> np.ndarray:
    """(H, W, 3) float32, 0 to 1: the chart seen from the front, with its black frame."""
    step = _PATCH + _GAP
    chart = np.full((4 * step + 3 * _GAP, 6 * step + 3 * _GAP, 3), 12, np.float32)
    for number, color in enumerate(colors):
        row, column = divmod(number, 6)
        top, left = 2 * _GAP + row * step, 2 * _GAP + column * step
        chart[top : top + _PATCH, left : left + _PATCH] = color
    return chart / 255


def view_of_chart(
    matrix: np.ndarray,
    seed: int = 0,
    *,
    turned: bool = False,
    chart: np.ndarray | None = None,
    noise: float = 2.0,
    size: tuple[int, int] = (WIDTH, HEIGHT),
) -> np.ndarray:
    """(H, W, 3) uint8 RGB: a camera's image of the chart on a gray wall, from a direction that the seed chooses.
    `matrix`: (3, 4) from the chart's sRGB (0 to 1, and 1) to the camera's; `noise`: in levels of 255."""
    rng = np.random.default_rng(seed)
    chart = flat_chart() if chart is None else chart
    chart = chart[::-1, ::-1] if turned else chart
    high, wide = chart.shape[:2]
    square = np.array([(0.2, 0.22), (0.8, 0.22), (0.8, 0.78), (0.2, 0.78)])
    corners = (square + rng.uniform(-0.06, 0.06, (4, 2))) * size
    flat = np.array([(0, 0), (wide, 0), (wide, high), (0, high)], np.float32)
    warp = cv2.getPerspectiveTransform(flat, corners.astype(np.float32))
    image = np.full((size[1], size[0], 3), 0.55, np.float32)
    cv2.warpPerspective(np.ascontiguousarray(chart), warp, size, image, cv2.INTER_AREA, cv2.BORDER_TRANSPARENT)
    image = image @ matrix[:, :3].T + matrix[:, 3] + rng.normal(0, noise / 255, image.shape)
    return (image.clip(0, 1) * 255 + 0.5).astype(np.uint8)


def matrices(count: int, seed: int = 1) -> np.ndarray:
    """(count, 3, 4): gains, crosstalk and offsets of cameras whose mean is neutral."""
    rng = np.random.default_rng(seed)
    found = rng.normal(0, 0.02, (count, 3, 4))
    found[:, range(3), range(3)] += rng.normal(0, 0.1, (count, 3))
    return found - found.mean(0) + np.eye(3, 4)


def write_charts(folder: Path, views: Mapping[str, np.ndarray | Sequence[np.ndarray]]) -> None:
    """images/CAMERA/FFF.png of the given images, one or several frames."""
    for name, images in views.items():
        (folder / "images" / name).mkdir(parents=True)
        for frame, image in enumerate([images] if isinstance(images, np.ndarray) else images):
            assert cv2.imwrite(str(folder / "images" / name / f"{frame:03d}.png"), image[..., ::-1])
