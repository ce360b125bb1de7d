"""Symbols of buttons: in the middle, sharp at upright edges, mirrored where their meaning is."""

from __future__ import annotations

import numpy as np
import pytest

from gui.drawing.symbols import SYMBOLS, framed, symbol

WHITE, DARK = (255, 255, 255), (0, 0, 0)


@pytest.mark.parametrize("size", [(35, 24), (70, 48)])
@pytest.mark.parametrize("name", sorted(SYMBOLS))
def test_a_symbol_is_in_the_middle(name: str, size: tuple[int, int]) -> None:
    picture = symbol(name, size, WHITE, DARK)
    assert picture.shape == (size[1], size[0], 3)
    rows, columns = np.nonzero(picture[..., 0] > 60)
    assert abs((columns.min() + columns.max() + 1) / 2 - size[0] / 2) <= 0.08 * size[1] + 1
    assert abs((rows.min() + rows.max() + 1) / 2 - size[1] / 2) <= 1


@pytest.mark.parametrize("scale", [1, 2])
def test_bars_are_sharp(scale: int) -> None:
    picture = symbol("pause", (35 * scale, 24 * scale), WHITE, DARK)
    assert set(np.unique(picture)) <= {0, 255}, "no gray between a bar and the button"
    row = picture[12 * scale, :, 0] > 0
    assert np.count_nonzero(np.diff(row.astype(int)) == 1) == 2, "two bars"


def test_back_and_forward_are_mirrored() -> None:
    for one, other in (("start", "end"), ("back", "forward")):
        left, right = (symbol(name, (48, 48), WHITE, DARK)[..., 0] > 127 for name in (one, other))
        assert np.count_nonzero(left ^ right[:, ::-1]) < 0.12 * np.count_nonzero(left)
    assert np.count_nonzero(symbol("play", (48, 48), WHITE, DARK)[..., 0] > 127) > 100


def test_a_border_goes_around_and_leaves_the_corners() -> None:
    inside, border, outside = (49, 53, 60), (128, 128, 128), (37, 40, 45)
    for scale in (1, 2):
        shown = framed(np.full((24 * scale, 35 * scale, 3), inside, np.uint8), border, outside)
        assert (shown[[0, -1], 17 * scale] == border).all()
        assert (shown[12 * scale, [0, -1]] == border).all()
        assert (shown[1:-1, 17 * scale] == inside).all()
        assert np.abs(shown[0, 0].astype(int) - outside).max() < 30
