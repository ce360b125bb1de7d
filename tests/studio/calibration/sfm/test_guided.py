"""Matches along epipolar lines, and cameras from them, compared with a synthetic rig."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.studio.calibration.sfm.jobs import job_of, rig_of
from v3studio.studio.calibration import compare_rigs
from v3studio.studio.calibration.sfm import mapping
from v3studio.studio.calibration.sfm.features import merge_sync_frames, write_images
from v3studio.studio.calibration.sfm.guided import write_guided_matches
from v3studio.studio.calibration.sfm.job import SfmJob

pycolmap = pytest.importorskip("pycolmap")

CAMERAS, POINTS = 8, 3000


@pytest.fixture
def rig(tmp_path: Path) -> tuple[Any, SfmJob, dict[int, np.ndarray]]:
    """The true model, its job, and the point that each keypoint of an image observes.

    Each image shows half of the points, six of which look alike. The databases have a fifth of the matches; keypoints
    are off by 0.5 pixels.
    """
    pycolmap.set_random_seed(1)
    options = pycolmap.SyntheticDatasetOptions(num_rigs=CAMERAS, num_cameras_per_rig=1, num_frames_per_rig=1)
    options.num_points3D = POINTS
    model = pycolmap.synthesize_dataset(options)
    job = job_of(CAMERAS, attempts=("incremental",))
    rng = np.random.default_rng(0)
    looks = rng.integers(0, 255, (POINTS // 6, 128), np.uint8)
    each = pycolmap.Database.open(tmp_path / "sync_frames.db")
    write_images(each, job)
    seen = {}
    for image in range(1, CAMERAS + 1):
        visible = [point for point in model.images[image].points2D if point.has_point3D() and rng.random() < 0.5]
        seen[image] = np.array([point.point3D_id for point in visible])
        pixels = np.array([point.xy for point in visible])
        each.write_keypoints(image, (pixels + rng.normal(0, 0.5, pixels.shape)).astype(np.float32))
        codes = pycolmap.FeatureDescriptors(pycolmap.FeatureExtractorType.SIFT, looks[seen[image] % len(looks)])
        each.write_descriptors(image, codes)
    for first in seen:
        for second in range(first + 1, CAMERAS + 1):
            _, a, b = np.intersect1d(seen[first], seen[second], return_indices=True)
            some = rng.permutation(len(a))[: len(a) // 5]
            geometry = pycolmap.TwoViewGeometry()
            geometry.config = pycolmap.TwoViewGeometryConfiguration.UNCALIBRATED
            geometry.inlier_matches = np.c_[a, b][some].astype(np.uint32)
            each.write_two_view_geometry(first, second, geometry)
    each.close()
    (tmp_path / "images").mkdir()
    merge_sync_frames(tmp_path / "sync_frames.db", tmp_path / "database.db", job)
    return model, job, seen


def test_features_that_look_alike_are_matched_where_the_rig_tells_them_apart(tmp_path: Path, rig: Any) -> None:
    model, job, seen = rig
    each, merged, out = (tmp_path / f"{name}.db" for name in ("sync_frames", "database", "guided"))
    write_guided_matches(each, merged, out, model, job, 3.0)
    count, right, possible = 0, 0, 0
    guided = pycolmap.Database.open(out)
    for key in guided.read_two_view_geometry_num_inliers()[0]:
        first, second = pycolmap.pair_id_to_image_pair(key)
        matches = guided.read_two_view_geometry(first, second).inlier_matches
        count += len(matches)
        right += int((seen[first][matches[:, 0]] == seen[second][matches[:, 1]]).sum())
        possible += len(np.intersect1d(seen[first], seen[second]))
    guided.close()
    assert possible >= POINTS
    assert right >= 0.9 * possible
    assert count - right <= 0.05 * count


def test_a_weak_camera_is_moved_by_new_matches(tmp_path: Path, rig: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Further away, with a longer focal length, it fits most of the old ones."""
    truth, job, _ = rig
    solver = mapping.Mapper(tmp_path, tmp_path / "database.db", job)
    (model,) = solver.incremental(False)
    frame, camera = model.frames[model.images[3].frame_id], model.cameras[3]
    away = pycolmap.Rigid3d(pycolmap.Rotation3d(), [0, 0, 0.05])
    frame.rig_from_world = away * frame.rig_from_world
    camera.params = [1.01 * camera.params[0], *camera.params[1:]]
    monkeypatch.setattr(mapping, "WEAK", 0.0)
    adjust = solver.adjust
    lengths: list[int] = []

    def counted(model: Any, **options: Any) -> None:
        lengths.extend(point.track.length() for point in model.points3D.values())
        adjust(model, **options)

    monkeypatch.setattr(solver, "adjust", counted)
    again = solver.matched_again(model)
    before, after = (compare_rigs(rig_of(solved), rig_of(truth)) for solved in (model, again))
    assert after.center_percent < 0.5 < before.center_percent
    assert min(lengths) == 3
    assert not (tmp_path / "guided.db").exists()
