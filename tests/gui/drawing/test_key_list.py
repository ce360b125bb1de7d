"""The picture of the shortcuts."""

from __future__ import annotations

import numpy as np

from gui.actions.keys import SHORTCUTS
from gui.drawing.key_list import key_list
from gui.drawing.palette import DIALOG, LINE


def test_all_shortcuts_fit_into_a_window_of_1280x800() -> None:
    picture = key_list(SHORTCUTS, 966, 16.0)
    assert picture.shape[1] == 966
    assert picture.shape[0] < 490, "with a title and a button, 0.78 of the window: the toolkit makes no dialog higher"
    used = (picture != DIALOG).any(axis=2) & (picture != LINE).any(axis=2)
    assert not used[:, -2:].any(), "nothing is cut off at the right"
    assert not used[-2:].any()
    left, right = used[:, :470].any(axis=1), used[:, 495:].any(axis=1)
    ends = [int(np.flatnonzero(one).max()) for one in (left, right)]
    assert min(ends) > 0.6 * picture.shape[0], "two columns of similar height"


def test_a_narrow_picture_is_higher() -> None:
    assert key_list(SHORTCUTS, 640, 16.0).shape[0] > key_list(SHORTCUTS, 966, 16.0).shape[0]
