"""EXR plates, read by OpenEXR's own library, against closed forms and the rasterizer."""

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest
import torch

from tests.studio.formats.conftest import MakeVideo
from tests.support.errors import refuses
from v3studio.studio.cameras import Camera
from v3studio.studio.formats.exr import MAX_DEEP, export_exr
from v3studio.studio.formats.plates import FAR, Shutter
from v3studio.studio.gaussians import Gaussians
from v3studio.studio.rasterizer import rasterize
from v3studio.studio.similarity import Similarity
from v3studio.studio.splat_video import SplatVideo

EYE, FOCAL = 3.0, 60.0
CAMERA = Camera.look_at((0, 0, EYE), (0, 0, 0), width=64, height=48, field_of_view=43.6)  # looks along -z, y is up
ACES = [[0.6131, 0.3395, 0.0474], [0.0702, 0.9164, 0.0135], [0.0206, 0.1096, 0.8698]]  # from linear Rec.709


def splat(*center: float, spread: float = 0.1, color: tuple[float, ...] = (0.8, 0.5, 0.2)) -> Gaussians:
    """One flat splat that faces +z, and has the opacity 0.95."""
    sh = (torch.tensor([[color]]) - 0.5) / 0.28209479
    scales = torch.tensor([[spread, spread, spread / 100]])
    return Gaussians.from_activated(
        torch.tensor([center]).float(), torch.tensor([[1.0, 0, 0, 0]]), scales, torch.tensor([0.95]), sh
    )


def moving(*centers: tuple[float, float, float], groups: tuple[int, ...] = (0,)) -> SplatVideo:
    frames = [splat(*center) for center in centers]
    return SplatVideo("test", 24.0, len(frames), groups, frames.__getitem__)


def exported(folder, video: SplatVideo, camera: Camera = CAMERA, world: Similarity | None = None, **options):
    """The header and the layers of each frame."""
    export_exr(video, folder, options.pop("path", lambda index: camera), world or Similarity(), **options)
    files = [OpenEXR.File(str(path)) for path in sorted(folder.iterdir())]
    names = {"Z": ["Z"], "P": ["P.X", "P.Y", "P.Z"], "N": ["N.X", "N.Y", "N.Z"], "forward": ["forward.u", "forward.v"]}
    found = []
    for file in files:
        channels = file.channels()
        layers = {"rgba": channels["RGBA"].pixels.astype(np.float32)}
        for name, keys in names.items():
            layers[name] = np.stack([channels[key].pixels.astype(np.float32) for key in keys], -1)
        found.append((file.header(), layers))
    return found


def encoded(linear: np.ndarray) -> np.ndarray:
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 0.0031308) ** (1 / 2.4) - 0.055)


def over(rgba: np.ndarray, color: np.ndarray) -> np.ndarray:
    """Porter and Duff 1984."""
    return rgba[..., :3] + (1 - rgba[..., 3:]) * color


@pytest.mark.parametrize("space", ["srgb", "rec709", "acescg"])
def test_over_a_color_it_is_the_renderers_image(tmp_path: Path, make_video: MakeVideo, space: str) -> None:
    video = make_video((2,), splats=300)
    camera = Camera.look_at((2.0, 0, 0.2), (0, 0, 0), (0, 0, 1), width=64, height=48)
    color = np.array([0.2, 0.7, 0.4])
    ((_, layers), _) = exported(tmp_path / "out", video, camera, color_space=space)
    rgba = layers["rgba"]
    alpha = rgba[..., 3:]
    if space != "srgb":  # splats are blended in sRGB
        straight = np.divide(rgba[..., :3], alpha, out=np.zeros_like(rgba[..., :3]), where=alpha > 0)
        linear = straight if space == "rec709" else straight @ np.linalg.inv(ACES).T
        rgba = np.concatenate([encoded(linear) * alpha, alpha], -1)
    meant = rasterize(video.read(0), camera, torch.tensor(color)).image.numpy()
    assert ((alpha > 0.1) & (alpha < 0.9)).sum() > 50
    np.testing.assert_allclose(over(rgba, color), meant, atol=2.5e-3)


def test_place_normal_and_camera_of_one_splat(tmp_path: Path) -> None:
    at = np.array([0.3, 0.2, 0.5])
    world = Similarity(2.0, np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]]), np.array([10.0, 0, 0]))
    ((header, layers),) = exported(tmp_path / "out", moving((0.3, 0.2, 0.5)), world=world, shutter=Shutter(90, 2))
    pixel = CAMERA.project(at[None])[0][0]
    column, row = (int(value) for value in pixel)
    assert layers["Z"][row, column, 0] == pytest.approx(2 * (EYE - at[2]), rel=1e-5)
    assert layers["Z"][0, 0, 0] == np.float32(FAR)
    assert not layers["P"][0, 0].any()
    np.testing.assert_allclose(layers["P"][row, column], world.points(at), atol=2 * 0.5 * (EYE - at[2]) / CAMERA.fx)
    np.testing.assert_allclose(layers["N"][row, column], world.directions(np.array([0, 0, 1.0])), atol=1e-3)
    place = np.append(layers["P"][row, column], 1)
    local = place @ header["worldToCamera"]
    np.testing.assert_allclose(local[2], -layers["Z"][row, column, 0], rtol=1e-5)  # it looks along -z
    clip = place @ header["worldToNDC"]
    ndc = clip[:2] / clip[3]
    back = (ndc * [1, -1] + 1) / 2 * [64, 48]
    np.testing.assert_allclose(back, [column + 0.5, row + 0.5], atol=1e-3)
    assert header["screenWindowWidth"] == pytest.approx(64 / CAMERA.fx)
    assert header["pinholeFocalLength"] / header["sensorOverallDimensions"][0] == pytest.approx(CAMERA.fx / 64)
    assert (header["framesPerSecond"], header["shutterAngle"], header["cameraLabel"]) == (24, 90, "view")


def test_motion_is_in_pixels_to_the_right_and_up(tmp_path: Path) -> None:
    video = moving((0, 0, 0), (0.1, 0.05, 0), (0.3, 0.05, 0), (0, 0, 0), groups=(0, 3))
    frames = exported(tmp_path / "out", video)
    scale = CAMERA.fx / EYE
    expected = [(0.1, 0.05), (0.2, 0), (0.2, 0), (0, 0)]  # a group's last frame moves on, a single one stands still
    for (_, layers), motion in zip(frames, expected, strict=True):
        drawn = layers["rgba"][..., 3] > 0
        assert drawn.sum() > 20
        np.testing.assert_allclose(layers["forward"][drawn] - np.multiply(motion, scale), 0, atol=1e-3)
        assert not layers["forward"][~drawn].any()


def test_a_moving_camera_moves_the_image(tmp_path: Path) -> None:
    path = lambda index: replace(CAMERA, world_to_camera=CAMERA.world_to_camera + np.eye(4, k=3) * 0.1 * index)  # noqa: E731
    (_, (_, layers)) = exported(tmp_path / "out", moving((0, 0, 0), (0, 0, 0)), path=path)
    drawn = layers["rgba"][..., 3] > 0
    np.testing.assert_allclose(layers["forward"][drawn, 0], 0.1 * CAMERA.fx / EYE, rtol=1e-4)


def test_blur_is_the_mean_while_the_shutter_is_open(tmp_path: Path) -> None:
    step, samples = 0.2, 6
    video = moving((-step, 0, 0), (0, 0, 0), (step, 0, 0))
    sharp = exported(tmp_path / "sharp", video, color_space="srgb")
    blurred = exported(tmp_path / "blurred", video, color_space="srgb", shutter=Shutter(360, samples))
    columns = np.arange(64) + 0.5

    def moments(layers) -> tuple[float, float, float]:
        weights = layers["rgba"][..., 3].sum(0).astype(np.float64)
        mean = (weights * columns).sum() / weights.sum()
        return weights.sum(), mean, (weights * (columns - mean) ** 2).sum() / weights.sum()

    for (_, still), (_, moved) in zip(sharp, blurred, strict=True):
        (area, middle, spread), (same_area, same_middle, wider) = moments(still), moments(moved)
        assert same_area == pytest.approx(area, rel=0.01)
        assert same_middle == pytest.approx(middle, abs=0.02)
        distance = step * CAMERA.fx / EYE
        assert wider - spread == pytest.approx(distance**2 * (1 - 1 / samples**2) / 12, rel=0.05)
        np.testing.assert_array_equal(moved["Z"], still["Z"])


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("overscan", {"overscan": -1}), ("shutter", {"shutter": Shutter(400, 2)}),
        ("samples", {"shutter": Shutter(90, 0)}), ("size with overscan", {"overscan": 9000}), ("deep", {"deep": -1}),
        ("deep", {"deep": MAX_DEEP + 1}),
    ],
)  # fmt: skip
def test_numbers_out_of_range(tmp_path: Path, name: str, options: dict[str, Any]) -> None:
    with refuses("export.invalid_setting", name=name):
        export_exr(moving((0, 0, 0)), tmp_path / "out", lambda index: CAMERA, Similarity(), **options)


def test_without_the_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "OpenImageIO", None)
    with refuses("exr.missing"):
        export_exr(moving((0, 0, 0)), tmp_path / "out", lambda index: CAMERA, Similarity())
