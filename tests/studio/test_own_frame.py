"""A take's own frame: which cameras get one, what they see in it, and that exports come back to where they were."""

import json
import struct
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from plyfile import PlyData
from scipy.spatial import cKDTree

from tests.support import rigs
from tests.support.errors import refuses
from tests.support.splats import cloud
from v3studio.pipelines.takes.results.videos import decoded_video
from v3studio.studio.cameras import Rig
from v3studio.studio.formats import read_splats
from v3studio.studio.formats.baking import bake_video
from v3studio.studio.formats.sequence import axes_of, export_sequence, open_import
from v3studio.studio.formats.videogs import export_videogs
from v3studio.studio.own_frame import frame_sentence, in_own_frame, own_frame, undone
from v3studio.studio.similarity import Similarity
from v3studio.studio.splat_video import SplatVideo
from v3studio.studio.stream import BakeSettings, StreamMetadata, StreamReader

FAR = np.array([5.0e6, -1.2e6, 300.0])


def ring(radius: float, middle: Sequence[float] | np.ndarray) -> Rig:
    return rigs.ring(6, radius=radius, target=middle, focal=500.0, size=(640, 360))


@pytest.mark.parametrize(
    ("radius", "middle", "scaled", "moved"),
    [
        (3.0, (0, 0, 0), False, False),
        (0.6, (1, 2, 0), False, False),
        (30.0, (100, 0, 0), False, False),
        (0.4, (1, 2, 0), True, False),
        (40.0, (100, 0, 0), True, False),
        (3.0, FAR, False, True),
        (3.0, (150, 0, 150), False, True),
        (0.001, (0, 0, 0), True, False),
        (3000.0, (0, 0, 0), True, False),
        (3000.0, FAR, True, True),
        (0.001, (0.001, 0, 0), True, False),
    ],
)
def test_odd_cameras_are_moved(radius: float, middle: tuple[float, float, float], scaled: bool, moved: bool) -> None:
    rig = ring(radius, middle)
    frame = own_frame(rig)
    assert (frame.scale != 1, bool(frame.translation.any())) == (scaled, moved)
    moved_rig = in_own_frame(rig)
    assert (moved_rig is rig) == (not scaled and not moved) == (frame_sentence(frame) is None)
    size = np.linalg.norm(moved_rig.centers - moved_rig.centers.mean(axis=0), axis=1).max()
    assert 0.5 <= size <= 32
    assert np.linalg.norm(moved_rig.centers.mean(axis=0)) <= 64 * size
    again = own_frame(moved_rig)
    assert (again.scale, again.translation.any()) == (1, False)
    point = np.asarray(middle) + radius * np.array([0.1, -0.2, 0.3])
    for before, after in zip(rig, moved_rig, strict=True):
        pixels = [camera.project(points[None])[0] for camera, points in ((before, point), (after, frame.points(point)))]
        np.testing.assert_allclose(pixels[1], pixels[0], atol=1e-4)
    np.testing.assert_allclose(frame.inverse.after(frame).points(point), point)


def video(original: Similarity) -> SplatVideo:
    splats = cloud(200)
    splats.log_scales.div_(2).sub_(2)
    return SplatVideo("take", 30.0, 1, (0,), lambda index: splats, up=np.array([0.0, 0.0, 1.0]), original=original)


@pytest.fixture(params=[3.0, 3000.0], ids=["meters", "millimeters"])
def original(request: pytest.FixtureRequest) -> Similarity:
    """The place of a take 5,000 km from zero, in meters or in millimeters."""
    return undone(own_frame(ring(request.param, FAR * request.param / 3)), placed=False)


def test_ply_and_glb_and_videogs_are_written_where_the_cameras_are(tmp_path: Path, original: Similarity) -> None:
    take = video(original)
    meant = original.points(take.read(0).means.numpy())
    sizes = take.read(0).log_scales.numpy() + np.log(original.scale)
    for suffix in (".ply", ".glb"):
        export_sequence(take, tmp_path / suffix[1:], suffix)
    rows = PlyData.read(str(tmp_path / "ply" / "frame_0000.ply"))["vertex"]
    points = np.stack([rows[name] for name in "xyz"], axis=1)
    np.testing.assert_allclose(points, meant, atol=1e-6 * original.scale)
    np.testing.assert_allclose(rows["scale_1"], sizes[:, 1], atol=1e-5)
    data = (tmp_path / "glb" / "frame_0000.glb").read_bytes()
    head = json.loads(data[20 : 20 + struct.unpack_from("<I", data, 12)[0]])
    bounds = head["accessors"][0]
    middle = (np.array(bounds["min"]) + bounds["max"]) / 2 + head["nodes"][0]["translation"]
    np.testing.assert_allclose(middle, (meant.min(axis=0) + meant.max(axis=0)) / 2, atol=1e-5 * original.scale)
    export_videogs(take, tmp_path / "videogs")
    info = json.loads((tmp_path / "videogs" / "viewer_min_max.json").read_text())["0"]["info"]
    np.testing.assert_allclose(np.reshape(info[:6], (3, 2)).T, [meant.min(axis=0), meant.max(axis=0)])


def test_far_imports_get_their_own_frame_and_exports_undo_it(tmp_path: Path, original: Similarity) -> None:
    take = video(original)
    meant = original.points(take.read(0).means.numpy())
    export_sequence(take, tmp_path / "far", ".ply")
    imported = open_import(tmp_path / "far")
    splats = imported.read(0)
    assert splats.means.abs().max() < 8
    assert any("far from zero" in note for note in imported.notes)
    assert not any("steps" in note for note in imported.notes)
    bake_video(imported, tmp_path / "stream", BakeSettings(quality=0))
    with StreamReader.open(tmp_path / "stream") as reader:
        decoded = decoded_video(reader)
        export_sequence(decoded, tmp_path / "back", ".ply")
    rows = PlyData.read(str(tmp_path / "back" / "frame_0000.ply"))["vertex"]
    back = np.stack([rows[name] for name in "xyz"], axis=1)
    distances, nearest = cKDTree(back).query(meant)
    assert distances.max() < 2e-4 * original.scale
    sizes = np.stack([rows[f"scale_{axis}"] for axis in range(3)], axis=1)[nearest]
    wanted = take.read(0).log_scales.numpy() + np.log(original.scale)
    np.testing.assert_allclose(np.sort(sizes), np.sort(wanted), atol=0.05)  # baking may swap axes


def test_files_for_viewers_have_the_units_but_not_the_place(tmp_path: Path, original: Similarity) -> None:
    take = video(original)
    rotation = axes_of(take, (0, 1, 0), True)
    export_sequence(take, tmp_path / "spz", ".spz", rotation)
    means = read_splats(tmp_path / "spz" / "frame_0000.spz").means.numpy()
    meant = original.scale * take.read(0).means.numpy() @ rotation.T
    np.testing.assert_allclose(means, meant, atol=1e-3 * original.scale)
    with refuses("splat_file.position_range"):  # no more digits than for whole meters
        export_sequence(take, tmp_path / "far", ".spz")


def test_the_stream_knows_where_it_was(original: Similarity) -> None:
    values = json.loads(json.dumps(StreamMetadata(original=original).to_json()))
    read = StreamMetadata.from_json(values).original
    assert read.scale == original.scale
    np.testing.assert_array_equal(read.translation, original.translation)
    assert "original" not in StreamMetadata().to_json()
    for damaged in ("far", {"scale": 0}, {**values["original"], "rotation": [0, 1, 0, 0]}):
        assert StreamMetadata.from_json({"original": damaged}).original.is_identity
