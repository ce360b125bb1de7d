"""The captures with exact masks: what their truth must satisfy."""

import sys
from pathlib import Path

import numpy as np
import pytest

FOLDER = Path(__file__).parents[2] / "benchmarks"


@pytest.mark.parametrize("name", ["shadows", "thin"])
def test_the_performer_only_takes_light_away_from_the_room(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(FOLDER))
    monkeypatch.delitem(sys.modules, "make_hard", raising=False)
    import make_hard

    monkeypatch.setattr(make_hard, "SAMPLES", [(0.5, 0.5)])  # one ray per pixel
    scene, camera = make_hard.SCENES[name], make_hard.cameras().cameras[3]
    room = make_hard.Room(scene, camera, make_hard.wall_picture(scene.pattern))
    parts = make_hard.performer(0.0, scene.thin)
    image, mask = make_hard.draw(room, make_hard.Body(parts), np.random.default_rng(0))
    plate = room.color(0, None)
    outside = mask == 0
    assert (image[outside] <= plate[outside] + 1e-6).all()
    shaded = outside & (image.sum(-1) < 0.95 * plate.sum(-1))
    assert 500 < shaded.sum() < 0.25 * outside.sum()
    # every part is in view, and covers the pixel of its middle, itself or by what is before it
    pixels, depth = camera.project(np.array([part.center for part in parts]))
    columns, rows = np.floor(pixels).astype(int).T
    assert (depth > 0).all()
    assert mask[rows, columns].all()
    assert 0.02 < mask.mean() < 0.15
    colors = (image[shaded] / np.maximum(plate[shaded], 1e-3)).clip(0, 1)
    spread = (colors.max(-1) - colors.min(-1)).max()
    assert (spread > 0.1) == (name == "shadows")  # of the channels' factors: only colored lights change hues
