"""Splats, surfaces and lines by depth, against blending by hand, pixel by pixel."""

import numpy as np
import pytest

from v3studio.gui.models.scene.compose import MOST_PER_PIXEL, SplatLayer, Surfaces, compose
from v3studio.gui.models.scene.fragments import Patch
from v3studio.gui.models.scene.fragments import fragments as made

BACKGROUND = (0.2, 0.4, 0.6)


def fragments(*items: tuple[int, float, float, int]) -> np.ndarray:
    """Fragments, each given as (pixel, depth, cover, gray)."""
    array = np.array(items, float).reshape(-1, 4)
    return made(*array[:, :3].T, array[:, 3:])


def splats(alpha: float, depth: float, level: float = 0.5) -> SplatLayer:
    """A layer of one pixel of a gray."""
    image = np.full((1, 1, 3), alpha * level, np.float32)
    return SplatLayer(image, np.full((1, 1), alpha, np.float32), np.full((1, 1), depth, np.float32))


def surface(depth: float | None, level: int = 0) -> Surfaces:
    """A pixel with a surface of a gray, or none."""
    surfaces = Surfaces(1, 1)
    if depth is not None:
        whole, gray = slice(None), np.full((1, 1, 3), level, np.uint8)
        surfaces.add(Patch(whole, whole, np.ones((1, 1), bool), gray, np.full((1, 1), depth)))
    return surfaces


def red(layer: SplatLayer | None, solid: Surfaces, parts: np.ndarray) -> float:
    """The first channel, 0 to 1."""
    return float(compose(BACKGROUND, layer, solid, parts)[0, 0, 0]) / 255


@pytest.mark.parametrize(
    ("alpha", "solid", "line", "expected"),
    [
        (0.0, None, None, 0.2),
        (0.8, None, None, 0.8 * 0.5 + 0.2 * 0.2),  # splats over the background
        (0.8, 5.0, None, 0.8 * 0.5 + 0.2 * 1.0),  # a white surface shines through
        (0.8, 1.0, None, 1.0),  # a surface in front hides them
        (0.8, None, 5.0, 0.8 * 0.5 + 0.2 * 1.0),  # a white line behind
        (0.8, None, 1.0, 1.0),  # in front
        (1.0, None, 5.0, 0.5),  # behind opaque splats
    ],
)
def test_what_is_behind_shines_through(alpha: float, solid: float | None, line: float | None, expected: float) -> None:
    parts = fragments() if line is None else fragments((0, line, 1.0, 255))
    assert red(splats(alpha, 2.0), surface(solid, 255), parts) == pytest.approx(expected, abs=0.003)


def test_lines_blend_far_ones_first_in_any_order() -> None:
    rng = np.random.default_rng(3)
    count = MOST_PER_PIXEL
    depth, cover, gray = rng.permutation(count) + 1.0, rng.uniform(0.2, 0.8, count), rng.integers(0, 256, count)
    expected = 0.2
    for line in np.argsort(-depth):
        expected += (gray[line] / 255 - expected) * cover[line]
    parts = fragments(*((0, depth[i], cover[i], gray[i]) for i in range(count)))
    assert red(None, surface(None), parts) == pytest.approx(expected, abs=0.003)
