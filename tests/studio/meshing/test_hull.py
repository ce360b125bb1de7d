"""Visual hulls: of balls with known geometry, with bad masks, and of the sample capture with its known mesh."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from tests.studio.meshing.conftest import Shot, color_of, distance_to_balls, two_balls
from tests.support.errors import refuses
from tests.support.rigs import camera_at
from tests.support.settings import refuses_setting
from v3studio.studio.camera_files import read_rig
from v3studio.studio.capture.video import VideoReader
from v3studio.studio.errors import StudioError
from v3studio.studio.meshing import HullResult, InitializeSettings, Mesh, initialize_points, sample_surface, visual_hull
from v3studio.studio.meshing.silhouettes import signed_distance, silhouettes

COARSE = InitializeSettings(resolution=48, max_faces=100_000)
SAMPLE = Path(__file__).parents[3] / "sample_captures" / "dance16"


@pytest.fixture(scope="module")
def carved() -> HullResult:
    """The hull of two balls in twelve cameras."""
    return visual_hull(two_balls(12), COARSE)


def volume_of(mesh: Mesh) -> float:
    """Signed volume by the divergence theorem; negative if faces are oriented inward."""
    a, b, c = np.moveaxis(mesh.corners, 1, 0)
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6)


def test_signed_distance_of_a_disc() -> None:
    rows, columns = np.mgrid[0:200, 0:200] + 0.5
    exact = 60.3 - np.hypot(rows - 100.2, columns - 99.6)
    mask = np.round(255 * np.clip(exact + 0.5, 0, 1)).astype(np.uint8)
    assert np.abs(signed_distance(mask) - exact).max() < 1.5
    near = np.abs(exact) < 0.3
    assert np.abs(signed_distance(mask) - exact)[near].max() < 0.05
    assert (signed_distance(np.zeros((4, 4), np.uint8)) < -5).all()
    assert (signed_distance(np.full((4, 4), 255, np.uint8)) > 5).all()


@pytest.mark.parametrize(("scale", "origin"), [(1000.0, (5e3, -2e3, 100.0)), (1e-3, (0.01, 0, -0.02))])
def test_hull_contains_the_object_and_little_more(scale: float, origin: tuple[float, float, float]) -> None:
    """Units and position do not matter."""
    result = visual_hull(two_balls(12, scale, origin), COARSE)
    distance = distance_to_balls(result.mesh.vertices, scale, origin)
    voxel = result.hull.voxel / scale
    assert voxel < 0.04
    assert distance.min() > -voxel  # the hull contains the object
    assert distance.mean() < 0.06  # the limit of 12 silhouettes
    assert distance.max() < 0.25
    assert max(result.disagreement.values()) < 0.06
    assert result.hull.outliers == {}


def test_one_outlier_mask_is_corrected_and_reported(carved: HullResult) -> None:
    """A camera whose mask has no right half must not halve the hull."""
    views = two_balls(12)
    mask = views[4].mask.copy()
    mask[:, mask.shape[1] // 2 :] = 0
    views[4] = replace(views[4], mask=mask)
    strict = visual_hull(views, InitializeSettings(resolution=48, tolerance=0))
    corrected = initialize_points(views, COARSE.replace(points=500))
    assert volume_of(strict.mesh) < 0.75 * volume_of(carved.mesh)
    assert volume_of(corrected.mesh) == pytest.approx(volume_of(carved.mesh), rel=0.1)
    assert max(corrected.disagreement, key=lambda name: corrected.disagreement[name]) == "cam04"
    outliers = [warning for warning in corrected.warnings if warning.code == "hull.outlier_mask"]
    assert [warning.fields["camera"] for warning in outliers] == ["cam04"]
    mismatches = [warning.fields["camera"] for warning in corrected.warnings if warning.code == "hull.mask_mismatch"]
    assert "cam04" in mismatches


def test_never_an_empty_mesh() -> None:
    """Too few cameras to correct outliers: the error names the camera."""
    views = two_balls(12)[:9:3]
    shifted = np.zeros_like(views[1].mask)
    shifted[:20, :20] = 255  # far from the ball
    views.append(replace(views[1], camera=replace(views[1].camera, name="odd"), mask=shifted))
    with refuses("hull.masks_disagree", cameras=("odd",), empty=()):
        visual_hull(views, InitializeSettings(resolution=48, tolerance=0))


def test_all_masks_empty() -> None:
    views = [replace(view, mask=np.zeros_like(view.mask)) for view in two_balls(4)]
    with refuses("hull.empty_masks", setting="capture.masks"):
        visual_hull(views)


def test_cameras_that_look_away() -> None:
    views = []
    for view in two_balls(4):
        center = view.camera.center
        views.append(replace(view, camera=camera_at(view.camera.name, center, 2 * center)))
    with pytest.raises(StudioError) as caught:
        visual_hull(views)
    assert caught.value.code in ("hull.no_overlap", "hull.masks_disagree")


def test_cameras_do_not_carve_outside_their_image() -> None:
    """In every second camera the ball is half outside the image: cameras do not carve what they cannot see."""
    views = [view.right_half() if index % 2 else view for index, view in enumerate(two_balls(12))]
    result = visual_hull(views, COARSE)
    distance = distance_to_balls(result.mesh.vertices)
    assert distance.min() > -result.hull.voxel
    assert distance.max() < 0.4


def test_bad_settings_and_views() -> None:
    views = two_balls(3)
    with refuses("hull.too_few_cameras", value=1, expected=2):
        visual_hull(views[:1])
    with refuses_setting("resolution"):
        InitializeSettings(resolution=4)
    bent = replace(views[0], camera=replace(views[0].camera, distortion=np.array([0.1, 0, 0, 0])))
    with refuses("hull.lens_distortion", camera="cam00"):
        visual_hull([bent, *views[1:]])
    small = replace(views[0], mask=views[0].mask[:10])
    with refuses("hull.mask_size", value=(160, 10), camera="cam00", expected=(160, 120)):
        visual_hull([small, *views[1:]])


def test_maps_respect_the_pixel_limit() -> None:
    views = two_balls(6)
    shapes = silhouettes(views, max_pixels=6 * 2000)
    assert sum(shape.map.numel() for shape in shapes) <= 6 * 2000 * 1.02
    points = torch.tensor([[0.0, 0, 0], [0.9, 0.9, 0.9]])
    full = silhouettes(views)  # reduced maps agree with full ones
    for one, other in zip(shapes, full, strict=True):
        reduced, seen = one.distance(points)
        exact, seen_too = other.distance(points)
        assert seen.tolist() == seen_too.tolist()
        np.testing.assert_allclose(reduced[seen], exact[seen], atol=0.05)  # the footprint of a reduced pixel is 0.045


def test_samples_are_even_and_reproducible() -> None:
    """A square of two triangles, and a tiny triangle far away: points are distributed by area."""
    vertices = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [5, 5, 5], [5.01, 5, 5], [5, 5.01, 5]], np.float64)
    mesh = Mesh(vertices, np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6]], np.int32))
    points, normals = sample_surface(mesh, 4000, seed=5)
    assert points.dtype == normals.dtype == np.float32
    square = points[points[:, 2] < 1]
    assert 3998 <= len(square) <= 4000
    counts = np.histogram2d(square[:, 0], square[:, 1], bins=4, range=[[0, 1], [0, 1]])[0]
    assert counts.min() > 180
    assert counts.max() < 320
    np.testing.assert_allclose(normals, [[0, 0, 1]] * 4000, atol=1e-6)
    np.testing.assert_array_equal(points, sample_surface(mesh, 4000, seed=5)[0])
    assert not np.array_equal(points, sample_surface(mesh, 4000, seed=6)[0])
    with refuses("mesh.point_count", value=0):
        sample_surface(mesh, 0)
    with refuses("mesh.no_area"):
        sample_surface(Mesh(np.zeros((3, 3)), np.array([[0, 1, 2]], np.int32)), 5)


def test_points_and_colors_of_a_ball() -> None:
    result = initialize_points(two_balls(12), COARSE.replace(points=2000), seed=3)
    assert result.points.shape == result.normals.shape == result.colors.shape == (2000, 3)
    outward = (result.normals * result.points).sum(1)
    on_big = np.linalg.norm(result.points, axis=1) < 0.55
    assert (outward[on_big] > 0).mean() > 0.97
    expected = color_of(result.points, np.zeros(3), 0.5)
    error = np.abs(result.colors - expected).mean(1)
    assert np.median(error) < 0.03
    assert np.quantile(error, 0.9) < 0.15


def test_mesh_file(tmp_path: Path, carved: HullResult) -> None:
    mesh = carved.mesh
    mesh.save(tmp_path / "mesh.ply")
    twin = Mesh.load(tmp_path / "mesh.ply")
    np.testing.assert_allclose(twin.vertices, mesh.vertices, atol=1e-5)
    np.testing.assert_array_equal(twin.faces, mesh.faces)
    assert [path.name for path in tmp_path.iterdir()] == ["mesh.ply"]
    with refuses("mesh.missing", file=tmp_path / "other.ply"):
        Mesh.load(tmp_path / "other.ply")
    (tmp_path / "empty.ply").write_text("not a mesh")
    with refuses("mesh.unreadable", file=tmp_path / "empty.ply"):
        Mesh.load(tmp_path / "empty.ply")


def test_sample_capture_against_its_true_mesh() -> None:
    """Measured: the hull's surface is 13 mm from the true one on average, the limit of 16 silhouettes."""
    import open3d as o3d

    views = []
    for camera in read_rig(SAMPLE / "cameras.json"):
        image = VideoReader(SAMPLE / "mattes" / f"{camera.name}.mkv").read(0)
        views.append(Shot(camera.resized(image.shape[1], image.shape[0]), image, image[..., 0]))
    result = visual_hull(views, InitializeSettings(resolution=160))
    assert max(result.disagreement.values()) < 0.04
    truth = Mesh.load(SAMPLE / "meshes" / "000000.ply")
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(o3d.t.geometry.TriangleMesh.from_legacy(truth.to_open3d()))
    points, _ = sample_surface(result.mesh, 5000)
    distance = scene.compute_distance(o3d.core.Tensor(points)).numpy()
    assert distance.mean() < 0.016
    assert np.quantile(distance, 0.95) < 0.06
    # silhouettes never cut into the object itself
    hull = o3d.t.geometry.RaycastingScene()
    hull.add_triangles(o3d.t.geometry.TriangleMesh.from_legacy(result.mesh.to_open3d()))
    inner, _ = sample_surface(truth, 5000)
    outside = hull.compute_signed_distance(o3d.core.Tensor(inner)).numpy()
    assert np.quantile(outside, 0.99) < 2 * result.hull.voxel
