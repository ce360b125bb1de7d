"""USD files against OpenUSD itself: its own API, its validators and its camera."""

import sys
import wave
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from pxr import Gf, Sdf, Usd, UsdGeom, UsdMedia, UsdValidation, UsdVol

from tests.studio.formats.conftest import MakeSplats, MakeVideo
from tests.support.errors import refuses
from tests.support.rigs import camera_at
from tests.support.sounds import ArrayPcm
from v3studio.studio.formats.rigid_motion import scaled, turned
from v3studio.studio.formats.sequence import axes_of, open_import
from v3studio.studio.formats.usd import UsdFrames, export_usd
from v3studio.studio.rotations import quats_to_matrices
from v3studio.studio.similarity import Similarity

SH = "radiance:sphericalHarmonicsCoefficients"
RAMP = np.linspace(-1, 1, 2400, dtype=np.float32)


def opened(path):
    stage = Usd.Stage.Open(str(path))
    registry = UsdValidation.ValidationRegistry()
    validators = [registry.GetOrLoadValidatorByName(metadata.name) for metadata in registry.GetAllValidatorMetadata()]
    assert len(validators) > 20
    assert [error.GetMessage() for error in UsdValidation.ValidationContext(validators).Validate(stage)] == []
    return stage


@pytest.mark.parametrize("ending", [".usdc", ".usdz", ".usda"])
def test_frames_as_openusd_reads_them(tmp_path: Path, make_video: MakeVideo, ending: str) -> None:
    video = replace(make_video((4, 3), degree=3), numbers=tuple(range(10, 17)))
    export_usd(video, tmp_path / f"walk{ending}", None)
    stage = opened(tmp_path / f"walk{ending}")
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode(), stage.GetTimeCodesPerSecond()) == (10, 16, 20)
    assert (UsdGeom.GetStageUpAxis(stage), UsdGeom.GetStageMetersPerUnit(stage)) == ("Y", 1)
    prims = [prim for prim in stage.Traverse() if prim.IsA(UsdVol.ParticleField3DGaussianSplat)]
    assert len(prims) == 2
    for index, splats in enumerate(video):
        time, prim = 10 + index, prims[index >= 4]
        shown = [UsdGeom.Imageable(prim).ComputeVisibility(time) == "inherited" for prim in prims]
        assert shown == [index < 4, index >= 4]
        get = lambda name, at=time, of=prim: np.array(of.GetAttribute(name).Get(at))  # noqa: E731
        error = np.abs(get("positions") - splats.means.numpy()).max(axis=1)
        assert (error <= 1e-3 * splats.scales.numpy().min(axis=1)).all()
        np.testing.assert_allclose(get("scalesh"), splats.scales, rtol=1e-3)
        np.testing.assert_allclose(get("opacitiesh"), splats.opacities, atol=0.5 / 255)
        # half a level of color, of the constant term and of the others' sum in any direction
        error = np.abs(get(f"{SH}h").reshape(-1, 16, 3) - splats.sh.numpy())
        assert error.max() * 0.2821 < 0.5 / 255
        turns = [Gf.Matrix3d(Gf.Quatd(quat)) for quat in prim.GetAttribute("orientationsh").Get(time)]
        expected = quats_to_matrices(splats.unit_quats.numpy().astype(np.float64))
        np.testing.assert_allclose(np.swapaxes(np.array(turns), 1, 2), expected, atol=4e-3)
        low, high = get("extent")
        assert (low < splats.means.numpy().min(axis=0)).all()
        assert (high > splats.means.numpy().max(axis=0)).all()
    samples = {attribute.GetName(): attribute.GetNumTimeSamples() for attribute in prims[0].GetAttributes()}
    assert (samples["positions"], samples["opacitiesh"], samples[f"{SH}h"]) == (4, 0, 0)  # what is constant, once


def test_upright_with_cameras_and_sound(tmp_path: Path, make_video: MakeVideo) -> None:
    camera = camera_at("cam 1", (2.0, 1.0, -0.5))
    there = Similarity(2.0, translation=np.array([4e5, 0, 0]))
    video = replace(make_video((3,)), sound=ArrayPcm(np.stack([RAMP, RAMP], axis=1), 8000), original=there)
    rotation = axes_of(video, (0, 1, 0), True)
    export_usd(video, tmp_path / "a.usdz", rotation, [camera])
    stage = opened(tmp_path / "a.usdz")
    frustum = UsdGeom.Camera(stage.GetPrimAtPath("/Performance/Cameras/cam_1")).GetCamera(0).frustum
    project = frustum.ComputeViewMatrix() * frustum.ComputeProjectionMatrix()
    points = np.array(stage.GetPrimAtPath("/Performance/Group_000").GetAttribute("positions").Get(1), np.float64)
    means = video.read(1).means.double().numpy()
    for point, original in zip(points[:20], means[:20], strict=True):
        x, y, _ = project.Transform(Gf.Vec3d(*point))
        seen = camera.K @ (camera.rotation @ original + camera.translation)
        expected = seen[:2] / seen[2]
        np.testing.assert_allclose([(x + 1) / 2 * camera.width, (1 - y) / 2 * camera.height], expected, atol=1e-2)
    export_usd(video, tmp_path / "b.usdc", None)
    stage = opened(tmp_path / "b.usdc")
    place = UsdGeom.Xformable(stage.GetPrimAtPath("/Performance/Group_000")).ComputeLocalToWorldTransform(0)
    assert list(place.ExtractTranslation()) == [4e5, 0, 0]
    sound = UsdMedia.SpatialAudio(stage.GetPrimAtPath("/Performance/Sound"))
    assert (sound.GetFilePathAttr().Get().path, sound.GetAuralModeAttr().Get()) == ("./b.wav", "nonSpatial")
    with wave.open(str(tmp_path / "b.wav")) as heard:
        assert (heard.getnchannels(), heard.getframerate(), heard.getnframes()) == (2, 8000, 2400)
        samples = np.frombuffer(heard.readframes(2400), "<i2")[::2]
    np.testing.assert_allclose(samples / 32767, RAMP, atol=1e-4)


def test_imported_again(tmp_path: Path, make_video: MakeVideo) -> None:
    video = make_video((4, 3), degree=1)
    export_usd(video, tmp_path / "a.usdc")
    back = open_import(tmp_path / "a.usdc")
    assert (back.fps, back.group_starts, back.up.tolist()) == (20, (0, 4), [0, 1, 0])
    for before, after in zip(video, back, strict=True):
        assert torch.equal(after.means, before.means)
        torch.testing.assert_close(after.scales, before.scales, rtol=1e-3, atol=0)
        torch.testing.assert_close(after.opacities, before.opacities, rtol=0, atol=1e-3)
        torch.testing.assert_close(after.sh, before.sh, rtol=1e-3, atol=1e-4)
    assert open_import(tmp_path / "a.usdc", fps=12).fps == 12


def define(path, splats):
    """A static file as another tool would write it: floats, a transform of its own, z up."""
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, "Z")
    prim = UsdVol.ParticleField3DGaussianSplat.Define(stage, "/World/Splats")
    values = {
        "positions": splats.means.tolist(),
        "orientations": [Gf.Quatf(*quat) for quat in splats.unit_quats.tolist()],
        "scales": splats.scales.tolist(),
        "opacities": splats.opacities.tolist(),
        SH: splats.sh.reshape(-1, 3).tolist(),
        "radiance:sphericalHarmonicsDegree": splats.sh_degree,
    }
    for name, value in values.items():
        prim.GetPrim().GetAttribute(name).Set(value)
    return stage, prim


def test_static_splats_of_another_tool_with_a_transform(tmp_path: Path, make_splats: MakeSplats) -> None:
    splats = make_splats(60, 2)
    stage, prim = define(tmp_path / "a.usda", splats)
    prim.AddTranslateOp().Set(Gf.Vec3d(1, 2, 3))
    prim.AddRotateZOp().Set(90.0)
    prim.AddScaleOp().Set(Gf.Vec3f(2, 2, 2))
    stage.Save()
    video = open_import(tmp_path / "a.usda")
    assert (video.frame_count, video.up.tolist()) == (1, [0, 0, 1])
    expected = scaled(turned(splats, np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])), 2.0)
    after = video.read(0)
    torch.testing.assert_close(after.means, expected.means + torch.tensor([1.0, 2, 3]), atol=1e-5, rtol=0)
    torch.testing.assert_close(after.scales, expected.scales)
    torch.testing.assert_close(after.sh, expected.sh, atol=1e-5, rtol=0)


def test_what_would_be_misread_is_refused(tmp_path: Path, make_splats: MakeSplats) -> None:
    splats = make_splats(8, 1)

    def refused(words: str, change) -> None:
        path = tmp_path / f"{len(list(tmp_path.iterdir()))}.usda"
        stage, prim = define(path, splats)
        change(prim)
        stage.Save()
        with refuses("usd.unsupported") as caught:
            open_import(path)
        assert words in caught.value.problem

    refused("stretches", lambda prim: prim.AddScaleOp().Set(Gf.Vec3f(1, 2, 1)))
    refused("scales has 7 values", lambda prim: prim.GetScalesAttr().Set(splats.scales[:7].tolist()))
    refused("degree 4", lambda prim: prim.GetRadianceSphericalHarmonicsDegreeAttr().Set(4))
    refused("orientations has no values", lambda prim: prim.GetOrientationsAttr().Clear())
    refused("no visible splats", lambda prim: prim.GetVisibilityAttr().Set("invisible"))
    refused("it has Mesh", lambda prim: prim.GetPrim().SetTypeName("Mesh"))
    (tmp_path / "x.usdc").write_bytes(b"PXR-USDC" + bytes(200))
    with refuses("usd.unsupported"):
        open_import(tmp_path / "x.usdc")


def test_one_static_prim_per_frame_that_is_shown_and_hidden(tmp_path: Path, make_splats: MakeSplats) -> None:
    stage, _ = define(tmp_path / "a.usda", make_splats(9))
    stage.Save()
    both = Usd.Stage.CreateNew(str(tmp_path / "both.usda"))
    for index in range(2):
        prim = both.DefinePrim(f"/World/{'ab'[index]}")
        prim.GetReferences().AddReference("./a.usda", "/World/Splats")
        UsdGeom.Xformable(prim).AddTranslateOp().Set(Gf.Vec3d(index, 0, 0))
        for time in range(3):
            UsdGeom.Imageable(prim).GetVisibilityAttr().Set("inherited" if time == index else "invisible", time)
    UsdGeom.Cube.Define(both, "/World/cube")
    both.Save()
    video = open_import(tmp_path / "both.usda")
    assert video.frame_count == 2
    torch.testing.assert_close(video.read(1).means, video.read(0).means + torch.tensor([1.0, 0, 0]))
    assert any("Cube" in note for note in video.notes)
    assert any("1 time code " in note for note in video.notes)


def test_unusable_splats_and_unknown_attributes_are_dropped(tmp_path: Path, make_splats: MakeSplats) -> None:
    splats = make_splats(50)
    splats.means[3, 0] = float("nan")
    stage, prim = define(tmp_path / "a.usda", splats)
    prim.AddTranslateOp().Set(Gf.Vec3d(1, 0, 0))
    prim.GetPrim().CreateAttribute("scan:confidence", Sdf.ValueTypeNames.Float).Set(0.5)
    stage.Save()
    video = open_import(tmp_path / "a.usda")
    assert len(video.read(0)) == 49
    assert any(note.startswith("1 splat dropped") for note in video.notes)
    assert sum("scan:confidence" in note for note in video.notes) == 1


def test_without_usd_core_it_is_named(tmp_path: Path, make_video: MakeVideo, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pxr", None)
    with refuses("usd.missing") as caught:
        export_usd(make_video(), tmp_path / "a.usdc")
    assert "usd-core" in caught.value.fix
    with refuses("usd.missing"):
        UsdFrames(tmp_path / "a.usdc")
    assert not list(tmp_path.iterdir())
