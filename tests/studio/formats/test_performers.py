"""Performers are told apart by the space between them, and followed from group to group."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import torch

from tests.support.errors import refuses
from tests.support.splats import round_splats
from v3studio.studio.cameras import Camera
from v3studio.studio.formats.exr import export_exr
from v3studio.studio.formats.performers import separated
from v3studio.studio.gaussians import Gaussians
from v3studio.studio.similarity import Similarity
from v3studio.studio.splat_video import SplatVideo

OpenEXR = pytest.importorskip("OpenEXR")

CAMERA = Camera.look_at((0, 0, 6), (0, 0, 0), width=120, height=80, field_of_view=40)  # x is to the right


def bodies(*places: float, seed: int = 0, splats: int = 1500) -> Gaussians:
    """Upright ellipsoids at these x, 0.4 wide and 1.6 high, with a floater between each two; in a shuffled order."""
    random = np.random.default_rng(seed)
    means = [random.normal(size=(splats, 3)) for _ in places]
    means = [0.95 * one / np.linalg.norm(one, axis=1, keepdims=True) * (0.2, 0.8, 0.2) for one in means]
    shifted = [one + np.array([x, 0, 0]) for one, x in zip(means, places, strict=True)]
    floaters = [[(a + b) / 2, 0, 0] for a, b in pairwise(places)]
    points = random.permutation(np.concatenate([*shifted, np.reshape(floaters, (-1, 3))]))
    return round_splats(torch.from_numpy(points).float(), -3.0, 0.9)


@pytest.mark.parametrize("places", [(0.0,), (-0.5, 0.5), (-1.4, 0.0, 0.9)])
def test_splats_belong_to_the_body_that_they_are_in(places: tuple[float, ...]) -> None:
    splats = bodies(*places)
    labels = separated(splats, len(places))
    x = splats.means[:, 0].numpy()
    for place in places:
        own = labels[np.abs(x - place) < 0.21]
        assert len(own) == 1500
        assert len(set(own)) == 1
    assert len(set(labels)) == len(places)


def test_a_ball_is_a_third_or_belongs_to_the_nearest() -> None:
    ball = bodies(0.3, splats=220)
    ball.means[:, 1] *= 0.25
    both = Gaussians.cat(bodies(-1.4, 1.4), ball)
    three, two = separated(both, 3), separated(both, 2)
    assert three is not None
    assert two is not None
    x = both.means[:, 0].numpy()
    for found, expected in ((three, 3), (two, 2)):
        assert len({tuple(set(found[np.abs(x - place) < 0.21])) for place in (-1.4, 0.3, 1.4)}) == expected
    assert set(two[np.abs(x - 0.3) < 0.21]) == set(two[np.abs(x - 1.4) < 0.21])


def mattes(folder, video: SplatVideo, count: int):
    """Alpha and the mattes of each frame, (H, W) and (H, W, count)."""
    export_exr(video, folder, lambda index: CAMERA, Similarity(), performers=count)
    found = []
    for path in sorted(folder.iterdir()):
        channels = OpenEXR.File(str(path)).channels()
        layers = [channels[f"matte.{number}"].pixels.astype(np.float32) for number in range(count)]
        found.append((channels["RGBA"].pixels[..., 3].astype(np.float32), np.stack(layers, -1)))
    return found


def test_mattes_add_up_to_alpha_and_follow_the_performers(tmp_path: Path) -> None:
    """Two cross, meeting in the middle of the first group; each group has its own splats."""
    lefts = [-0.8, 0.0, 0.6, 0.9, 1.0]
    groups = (0, 0, 0, 1, 1)
    frames = [bodies(x, -x, seed=group) for x, group in zip(lefts, groups, strict=True)]
    # within a group, splats correspond: those of the first body are those that began on the left
    video = SplatVideo("test", 25.0, 5, (0, 3), frames.__getitem__)
    columns = np.arange(CAMERA.width) + 0.5
    for x, (alpha, parts) in zip(lefts, mattes(tmp_path / "out", video, 2), strict=True):
        np.testing.assert_allclose(parts.sum(-1), alpha, atol=2e-3)
        middles = (parts.sum(0) * columns[:, None]).sum(0) / parts.sum((0, 1))
        wanted = 60 + np.array([x, -x]) * CAMERA.fx / 6
        np.testing.assert_allclose(middles, wanted, atol=2)


def test_performers_that_touch_are_refused(tmp_path: Path) -> None:
    video = SplatVideo("test", 25.0, 1, (0,), lambda index: bodies(-0.1, 0.1))
    with refuses("exr.performers", value=2):
        mattes(tmp_path / "out", video, 2)
    assert list(tmp_path.iterdir()) == []
