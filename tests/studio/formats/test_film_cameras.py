"""Cameras of film tools: USD files written by OpenUSD, and Nuke scripts with poses known in closed form."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom
from scipy.spatial.transform import Rotation

from tests.studio.formats.conftest import MakeVideo
from tests.support.errors import refuses
from tests.support.rigs import camera_at
from v3studio.studio.formats import nuke_cameras, usd_cameras
from v3studio.studio.formats.camera_path import CameraPath, read_film_keys
from v3studio.studio.formats.usd import export_usd
from v3studio.studio.similarity import Similarity

SIZE = (640, 360)


def turn(axis: int, degrees: float) -> np.ndarray:
    return Rotation.from_euler("xyz"[axis], degrees, degrees=True).as_matrix()


def nuke(path, *knobs: str, before: str = "", kind: str = "Camera3"):
    lines = "\n ".join(knobs)
    path.write_text(f"set cut_paste_input [stack 0]\nversion 13.2 v1\n{before}{kind} {{\n {lines}\n name shot\n}}\n")
    return path


def test_a_nuke_camera(tmp_path: Path) -> None:
    path = nuke(
        tmp_path / "a.nk", "inputs 0", "rot_order XZY", "translate {{curve i x1001 1 2 3} -4 {curve x1001 5}}",
        "rotate {10 {curve x1001 20 x1002 25 x1003 30} -30}", "focal {{curve K x1001 36}}", "haperture 24",
        'label "a {brace} and a \\"quote\\""', "selected true", "xpos -40",
    )  # fmt: skip
    ((name, cameras),) = nuke_cameras.read_cameras(path, *SIZE).items()
    assert (name, list(cameras)) == ("shot", [1001, 1002, 1003])
    for step, camera in enumerate(cameras.values()):
        np.testing.assert_allclose(camera.center, [1 + step, -4, 5], atol=1e-12)
        meant = turn(1, 20 + 5 * step) @ turn(2, -30) @ turn(0, 10)  # X first, then Z, then Y
        np.testing.assert_allclose(camera.forward, meant @ [0, 0, -1], atol=1e-12)
        np.testing.assert_allclose(-camera.rotation[1], meant @ [0, 1, 0], atol=1e-12)
        assert (camera.fx, camera.fy, camera.cx, camera.cy) == (960, 960, 320, 180)


def test_a_nuke_camera_by_matrix_stands_still(tmp_path: Path) -> None:
    rows = np.eye(4)
    rows[:3, :3], rows[:3, 3] = turn(1, 90), (1, 2, 3)
    listed = " ".join("{" + " ".join(map(str, row)) + "}" for row in rows)
    path = nuke(tmp_path / "a.nk", "inputs 0", "useMatrix true", f"matrix {{{listed}}}")
    ((_, cameras),) = nuke_cameras.read_cameras(path, *SIZE).items()
    (camera,) = cameras.values()
    np.testing.assert_allclose(camera.center, [1, 2, 3], atol=1e-12)
    np.testing.assert_allclose(camera.forward, [-1, 0, 0], atol=1e-12)
    assert camera.fx == pytest.approx(50 / 24.576 * 640)  # Nuke's lens


@pytest.mark.parametrize(
    ("knob", "before", "code"),
    [
        *((knob, "", "nuke.unsupported") for knob in (
            "translate {{curve x1 0 x10 1} 0 0}", "translate {{curve x1 0 nan} 0 0}", "translate {{curve} 0 0}",
            "rotate {{sin(frame)} 0 0}", "translate {1 2}", "win_translate {0.1 0}", "scaling {2 2 2}",
            "projection_mode orthographic", "rot_order XXY",
        )),
        ("translate {0 0 1}", "Axis2 {\n inputs 0\n translate {1 0 0}\n}\n", "nuke.unsupported"),
        ("translate {{curve x5 0 x4 1} 0 0}", "", "camera_path.times"),
        ("focal 0", "", "camera.focal_length"),
        ("translate {0 0 {1}", "", "nuke.syntax"),
    ],
)  # fmt: skip
def test_what_cannot_be_read_is_refused(tmp_path: Path, knob: str, before: str, code: str) -> None:
    with refuses(code):
        nuke_cameras.read_cameras(nuke(tmp_path / "a.nk", knob, before=before), *SIZE)


def test_scripts_with_and_without_a_camera(tmp_path: Path) -> None:
    path = nuke(tmp_path / "a.nk", "focal 50\n}\nBlur {")
    assert list(nuke_cameras.read_cameras(path, *SIZE)) == ["Camera3"]
    with refuses("nuke.no_camera"):
        nuke_cameras.read_cameras(nuke(path, "size 3", kind="Blur"), *SIZE)


def test_cameras_that_were_exported_come_back(tmp_path: Path, make_video: MakeVideo) -> None:
    rotation = turn(0, -90)  # from z up to y up
    K = np.array([[210.0, 0, 90], [0, 205, 55], [0, 0, 1]])
    cameras = [camera_at("a", (2, 1, 0.5), K=K), camera_at("b", (0, 2, 0.3))]
    export_usd(make_video((2,)), tmp_path / "a.usdc", rotation, cameras)
    found = usd_cameras.read_cameras(tmp_path / "a.usdc", 160, 120)
    assert list(found) == ["a", "b"]
    for camera in cameras:
        meant = Similarity(rotation=rotation).camera(camera)
        (back,) = found[camera.name].values()
        np.testing.assert_allclose(back.world_to_camera, meant.world_to_camera, atol=1e-6)
        np.testing.assert_allclose(back.resized(160, 120).K, meant.K, rtol=1e-6)


@pytest.fixture
def animated(tmp_path: Path) -> Path:
    """A camera in a file with z up and centimeters, below a transform, which has samples in frames 10 and 12."""
    stage = Usd.Stage.CreateNew(str(tmp_path / "shot.usda"))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdGeom.SetStageMetersPerUnit(stage, 0.01)
    parent = UsdGeom.Xform.Define(stage, "/rig")
    parent.AddScaleOp().Set(Gf.Vec3f(2, 2, 2))
    camera = UsdGeom.Camera.Define(stage, "/rig/shot")
    move = camera.AddTranslateOp()
    move.Set(Gf.Vec3d(50, 0, 100), 10)
    move.Set(Gf.Vec3d(150, 0, 100), 12)
    camera.AddRotateXOp().Set(90)  # level, with z up, and looks along y
    camera.CreateHorizontalApertureAttr(36)
    camera.CreateVerticalApertureAttr(20.25)
    camera.CreateFocalLengthAttr(18)
    UsdGeom.Camera.Define(stage, "/still")
    stage.GetRootLayer().Save()
    return tmp_path / "shot.usda"


def test_an_animated_usd_camera(animated: Path) -> None:
    cameras = usd_cameras.read_cameras(animated, *SIZE)["shot"]
    assert list(cameras) == [10, 11, 12]
    for step, camera in enumerate(cameras.values()):
        np.testing.assert_allclose(camera.center, [1 + step, 2, 0], atol=1e-6)
        np.testing.assert_allclose(camera.forward, [0, 0, -1], atol=1e-6)
        np.testing.assert_allclose(camera.rotation[1], [0, -1, 0], atol=1e-6)
        assert (camera.width, camera.height, camera.fx) == (640, 360, pytest.approx(320))


def test_keys_are_at_the_frames_of_the_video(animated: Path) -> None:
    keys = read_film_keys(animated, "shot", SIZE, (9, 10, 11), 20.0)
    assert [key.frame for key in keys] == [1, 2, 3]
    path = CameraPath(keys, *SIZE)
    for index, x in ((1, 1), (1.5, 1.5), (2, 2), (3, 3), (0, 1), (9, 3)):  # it stands still before and after
        assert path.camera(path.seconds_of(index)).center[0] == pytest.approx(x, abs=1e-6)
    assert len(read_film_keys(animated, "still", SIZE, (9, 10), 20.0)) == 1
    with refuses("camera_path.which_camera", expected=["shot", "still"]):
        read_film_keys(animated, None, SIZE, (9, 10), 20.0)
    with refuses("camera_path.which_camera", value="other"):
        read_film_keys(animated, "other", SIZE, (9, 10), 20.0)
    with refuses("camera_path.other_frames", value=[10, 12]):
        read_film_keys(animated, "shot", SIZE, (100, 101), 20.0)


@pytest.mark.parametrize("frames", [(0, 4, 4), (0, 4, 2)])
def test_a_frame_that_is_shown_twice_has_no_camera(animated: Path, frames: tuple[int, ...]) -> None:
    keys = read_film_keys(animated, "shot", SIZE, (10, 11, 12), 20.0)
    path = CameraPath([replace(key, frame=frame) for key, frame in zip(keys, frames, strict=True)], *SIZE)
    with refuses("camera_path.frames_not_ascending"):
        path.seconds_of(1)


@pytest.mark.parametrize(
    ("change", "code"),
    [
        (lambda stage, camera: camera.CreateProjectionAttr(UsdGeom.Tokens.orthographic), "usd.unsupported"),
        (lambda stage, camera: camera.AddScaleOp().Set(Gf.Vec3f(1, 2, 1)), "usd.unsupported"),
        (lambda stage, camera: camera.GetHorizontalApertureAttr().Set(0.0), "usd.unsupported"),
        (lambda stage, camera: [stage.RemovePrim(path) for path in ("/rig", "/still")], "usd.no_camera"),
    ],
)
def test_refused_usd_cameras(animated: Path, change: Callable[[Usd.Stage, UsdGeom.Camera], object], code: str) -> None:
    stage = Usd.Stage.Open(str(animated))
    change(stage, UsdGeom.Camera(stage.GetPrimAtPath("/rig/shot")))
    stage.GetRootLayer().Save()
    with refuses(code):
        usd_cameras.read_cameras(animated, *SIZE)
