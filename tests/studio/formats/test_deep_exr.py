"""Deep EXR files, read by OpenEXR's own library."""

from pathlib import Path

import numpy as np
import OpenEXR
import pytest

from tests.studio.formats.conftest import MakeVideo
from tests.studio.formats.test_exr import CAMERA, EYE, over, splat
from v3studio.studio.cameras import Camera
from v3studio.studio.formats.exr import export_exr
from v3studio.studio.formats.plates import Shutter
from v3studio.studio.gaussians import Gaussians
from v3studio.studio.similarity import Similarity
from v3studio.studio.splat_video import SplatVideo


def exported(folder, video: SplatVideo, camera: Camera, deep: int, **options):
    """The first frame: (H, W, 4) of its plate, and (H, W) arrays of its samples, (N, 4) RGBA and (N,) distances."""
    world = options.pop("world", Similarity())
    export_exr(video, folder, lambda index: camera, world, deep=deep, **options)
    plate, found = (OpenEXR.File(str(folder / f"{name}.0000.exr")) for name in ("plate", "deep"))
    for name in ("dataWindow", "displayWindow", "worldToCamera", "colorInteropID"):
        np.testing.assert_array_equal(found.header()[name], plate.header()[name])
    channels = found.channels()
    return plate.channels()["RGBA"].pixels.astype(np.float64), channels["RGBA"].pixels, channels["Z"].pixels


def composited(samples) -> np.ndarray:
    """Porter and Duff's "over" of a pixel's samples, the first in front."""
    result = np.zeros(4)
    for one in reversed([] if samples is None else samples.astype(np.float64)):
        result = np.append(over(one, result[:3]), one[3] + (1 - one[3]) * result[3])
    return result


@pytest.mark.parametrize(("space", "shutter"), [("srgb", 0), ("acescg", 0), ("acescg", 180)])
def test_over_the_samples_it_is_the_plate(tmp_path: Path, make_video: MakeVideo, space: str, shutter: int) -> None:
    video = make_video((2,), splats=300)
    camera = Camera.look_at((2.0, 0, 0.2), (0, 0, 0), (0, 0, 1), width=48, height=36)
    sharp, _, _ = exported(tmp_path / "sharp", video, camera, 1, color_space=space)
    options = {"color_space": space, "shutter": Shutter(shutter, 3), "overscan": 5}
    _, colors, distances = exported(tmp_path / "out", video, camera, 6, **options)
    counts = np.array([0 if samples is None else len(samples) for samples in distances.ravel()])
    assert counts.max() == 6
    assert all((np.diff(samples) >= 0).all() for samples in distances.ravel() if samples is not None)
    flattened = np.array([composited(samples) for samples in colors.ravel()]).reshape(*colors.shape, 4)[5:-5, 5:-5]
    np.testing.assert_allclose(flattened, sharp, rtol=0, atol=0.5 / 255)
    assert sharp[..., 3].max() > 0.9


def test_samples_are_where_the_splats_are(tmp_path: Path) -> None:
    both = Gaussians.cat(splat(0, 0, -0.5, color=(0.1, 0.8, 0.1)), splat(0, 0, 0.5, color=(0.8, 0.1, 0.1)))
    video = SplatVideo("test", 24.0, 1, (0,), lambda index: both)
    world = Similarity(2.0, np.eye(3), np.zeros(3))
    _, colors, distances = exported(tmp_path / "out", video, CAMERA, 2, world=world, color_space="srgb")
    np.testing.assert_allclose(distances[24, 32], [2 * (EYE - 0.5), 2 * (EYE + 0.5)], rtol=1e-5)
    front, back = colors[24, 32]
    assert 0.85 < back[3] < front[3] < 0.95
    np.testing.assert_allclose(front[:3] / front[3], [0.8, 0.1, 0.1], atol=2e-3)
    np.testing.assert_allclose(back[:3] / back[3], [0.1, 0.8, 0.1], atol=2e-3)
    assert distances[0, 0] is None or len(distances[0, 0]) == 0
