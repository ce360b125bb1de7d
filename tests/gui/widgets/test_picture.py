"""Pictures of sizes that come again need no new images: Open3D keeps the texture of each that it has drawn."""

from __future__ import annotations

import numpy as np
import pytest
from open3d.visualization import gui

from gui.widgets.picture import DRAWS_BEFORE_EXACT, PictureWidget


def test_sizes_that_come_again_need_no_new_images(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[tuple[int, ...]] = []

    class Counted(gui.UIImage):  # type: ignore[misc]
        def __init__(self, image: object) -> None:
            made.append(np.asarray(image).shape)
            super().__init__(image)

    monkeypatch.setattr(gui, "UIImage", Counted)
    picture = PictureWidget()
    sizes = [(40, 60 + 10 * number, 3) for number in range(12)]
    for level in range(3):
        for size in sizes:
            picture.show(np.full(size, 80 * level, np.uint8))
            for _ in range(DRAWS_BEFORE_EXACT):
                picture.settle()
    assert made[1:] == sizes, "one for each size, after that of an empty widget"
