"""The mapper on COLMAP's own synthetic rigs, whose truth is known; moments merged into one image a camera."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from studio.calibration import compare_rigs
from studio.calibration.sfm import neighbours
from studio.calibration.sfm_features import _merge, count_rows, write_image, write_lenses
from studio.calibration.sfm_worker import Worker
from studio.camera_files.colmap_model import intrinsics
from studio.cameras import Camera, Rig

pycolmap = pytest.importorskip("pycolmap")


def job_of(count: int, **settings: Any) -> dict[str, Any]:
    lens = {"model": "SIMPLE_RADIAL", "width": 1024, "height": 768, "params": [1280.0, 512.0, 384.0, 0.0]}
    return {
        "names": [str(number) for number in range(count)],
        "moments": 1,
        "lenses": [{**lens, "known": False, "prior": False} for _ in range(count)],
        "lens_of": list(range(count)),
        "masks": False,
        "pairs": [],
        "poses": [],
        "keep_poses": False,
        "mapper": "incremental",
        "seed": 0,
        "threads": 1,
        "keep_known": True,
        "refine_principal_point": False,
        **settings,
    }


def synthesise(folder: Path, count: int, points: int) -> Rig:
    """A database of a rig with 0.5 pixels of noise and 10 % wrong matches, and the true cameras, named by number."""
    pycolmap.set_random_seed(1)
    database = pycolmap.Database.open(folder / "database.db")
    options = pycolmap.SyntheticDatasetOptions()
    options.num_rigs, options.num_cameras_per_rig, options.num_frames_per_rig = count, 1, 1
    options.num_points3D, options.inlier_match_ratio = points, 0.9
    truth = pycolmap.synthesize_dataset(options, database)
    noise = pycolmap.SyntheticNoiseOptions()
    noise.point2D_stddev = 0.5
    pycolmap.synthesize_noise(noise, pycolmap.Reconstruction(truth), database)
    for image in database.read_all_images():
        image.name = f"{image.image_id - 1:04d}.png"
        database.update_image(image)
    database.close()
    (folder / "images").mkdir()
    cameras = []
    for key in sorted(truth.images):
        image = truth.images[key]
        lens = truth.cameras[image.camera_id]
        K, distortion = intrinsics(lens.model.name, list(lens.params))
        pose = np.asarray(image.cam_from_world().matrix())
        cameras.append(Camera(str(key - 1), lens.width, lens.height, K, pose, distortion))
    return Rig(tuple(cameras))


def solution(folder: Path) -> tuple[Rig, dict[str, Any]]:
    found = json.loads((folder / "solution.json").read_text())
    cameras = []
    for entry in found["cameras"]:
        K, distortion = intrinsics(entry["model"], entry["params"])
        cameras.append(Camera(str(entry["number"]), 1024, 768, K, np.array(entry["pose"]), distortion))
    return Rig(tuple(cameras)), found


def test_synthetic_rig_of_eight(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    truth = synthesise(tmp_path, 8, 800)
    Worker(tmp_path, job_of(8)).solve(tmp_path / "database.db")
    rig, found = solution(tmp_path)
    assert len(rig) == 8
    assert found["mapper"] == "incremental"
    difference = compare_rigs(rig, truth)
    # what this noise allows with so few points: the adjustment that starts from the truth ends as far from it
    assert difference.center_percent < 0.4
    assert difference.rotation_degrees < 0.1
    poses = [camera.world_to_camera[:3].tolist() for camera in truth]
    Worker(tmp_path, job_of(8, poses=poses)).solve(tmp_path / "database.db")
    best, found = solution(tmp_path)
    assert found["mapper"] == "known poses"
    assert compare_rigs(rig, best).center_percent < 0.02
    said = [json.loads(line) for line in capfd.readouterr().out.splitlines()]
    assert {line["step"] for line in said} == {"mapping"}


def test_an_old_solution_is_a_template(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Start from poses that are a degree and a percent off: they come back. Kept, they stay as they are."""
    truth = synthesise(tmp_path, 6, 600)
    rng = np.random.default_rng(0)
    radius = np.linalg.norm(truth.centers - truth.centers.mean(0), axis=1).mean()
    before = []
    for camera in truth:
        import cv2

        pose = camera.world_to_camera.copy()
        pose[:3, :3] = cv2.Rodrigues(np.radians(rng.normal(0, 0.15, 3)))[0] @ pose[:3, :3]
        pose[:3, 3] = -pose[:3, :3] @ (camera.center + rng.normal(0, 0.004 * radius, 3))
        before.append(replace(camera, world_to_camera=pose))
    poses = [camera.world_to_camera[:3].tolist() for camera in before]
    off = compare_rigs(Rig(tuple(before)), truth)
    job = job_of(6, poses=poses)
    Worker(tmp_path, job).solve(tmp_path / "database.db")
    rig, found = solution(tmp_path)
    assert found["mapper"] == "known poses"
    difference = compare_rigs(rig, truth)
    assert difference.center_percent < 0.3 < off.center_percent
    assert difference.rotation_degrees < 0.1 < off.rotation_degrees
    Worker(tmp_path, {**job, "keep_poses": True}).solve(tmp_path / "database.db")
    kept, _ = solution(tmp_path)
    for camera, start in zip(kept, before, strict=True):
        np.testing.assert_allclose(camera.world_to_camera, start.world_to_camera, atol=1e-9)


def test_a_lens_that_runs_away_is_steadied(tmp_path: Path) -> None:
    """A focal length of four millions is not taken for an answer."""
    from studio.calibration.sfm_mapping import Mapper

    synthesise(tmp_path, 4, 300)
    mapper = Mapper(tmp_path, tmp_path / "database.db", job_of(4))
    (model,) = mapper._incremental(False)
    assert mapper._broken_lenses(model) == set()
    model.cameras[2].params = [4e6, 512.0, 384.0, 0.0]
    assert mapper._broken_lenses(model) == {1}
    assert mapper._rank(model)[0] == 3
    (mended,) = mapper._steadied([model], {1}, "incremental")
    assert mapper._broken_lenses(mended) == set()
    assert mended.cameras[2].mean_focal_length() == pytest.approx(1280, rel=0.02)


def test_moments_become_one_image_a_camera(tmp_path: Path) -> None:
    """Two cameras, two moments: keypoints one after the other, matches with them."""
    rng = np.random.default_rng(0)
    job = job_of(2, moments=2)
    each = pycolmap.Database.open(tmp_path / "moments.db")
    lenses = write_lenses(each, job)
    # points before two cameras side by side
    points = rng.uniform([-1, -1, 4], [1, 1, 8], (80, 3))
    keypoints = {}
    for number in range(2):
        local = points - [0.8 * number, 0, 0]
        pixels = local[:, :2] / local[:, 2:] * 1280 + [512, 384]
        for moment in range(2):
            image = write_image(each, f"{number}_{moment}", *lenses[number])
            part = pixels[:30] if moment == 0 else pixels[30:]
            keypoints[number, moment] = part
            each.write_keypoints(image, part.astype(np.float32))
    for moment, count in ((0, 30), (1, 50)):
        geometry = pycolmap.TwoViewGeometry()
        geometry.config = pycolmap.TwoViewGeometryConfiguration.UNCALIBRATED
        geometry.inlier_matches = np.repeat(np.arange(count)[:, None], 2, axis=1).astype(np.uint32)
        each.write_two_view_geometry(moment + 1, moment + 3, geometry)
    each.close()
    _merge(tmp_path / "moments.db", tmp_path / "database.db", job)
    final = pycolmap.Database.open(tmp_path / "database.db")
    assert [image.name for image in final.read_all_images()] == ["0000.png", "0001.png"]
    for number in range(2):
        together = np.concatenate([keypoints[number, 0], keypoints[number, 1]])
        np.testing.assert_allclose(final.read_keypoints(number + 1)[:, :2], together, rtol=1e-6)
    matches = final.read_two_view_geometry(1, 2).inlier_matches
    assert len(matches) == 80
    assert (matches[:, 0] == matches[:, 1]).all()
    final.close()
    assert count_rows(tmp_path / "database.db", "SELECT COUNT(*) FROM images") == 2
    assert count_rows(tmp_path / "nothing.db", "SELECT COUNT(*) FROM images") == 0


def test_neighbours_look_the_same_way() -> None:
    cameras = []
    for index in range(12):
        angle = np.radians(30 * index)
        center = np.array([3 * np.cos(angle), 3 * np.sin(angle), 0.0])
        forward = -center / 3
        right = np.cross(forward, [0, 0, 1.0])
        rotation = np.stack([right, np.cross(forward, right), forward])
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = rotation, -rotation @ center
        cameras.append(Camera(f"c{index}", 64, 48, np.array([[50.0, 0, 32], [0, 50, 24], [0, 0, 1]]), pose))
    pairs = neighbours(Rig(tuple(cameras)), each=4)
    steps = {min((b - a) % 12, (a - b) % 12) for a, b in pairs}
    assert steps == {1, 2}  # 90 degrees apart is too far
    assert len(pairs) == 24


@pytest.mark.skipif(sys.platform != "linux", reason="asks Linux")
def test_the_worker_dies_with_its_parent(tmp_path: Path) -> None:
    """kill -9 leaves the parent no time to say goodbye."""
    program = f"""
import subprocess, sys, time
child = subprocess.Popen([sys.executable, "-c", '''
import os, time
from studio.calibration.sfm_worker import _die_with_parent
_die_with_parent()
open({str(tmp_path / "child")!r}, "w").write(str(os.getpid()))
time.sleep(60)
'''])
time.sleep(60)
"""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    parent = subprocess.Popen([sys.executable, "-c", program], env=environment)
    try:
        deadline = time.monotonic() + 30
        while not (tmp_path / "child").exists() or not (tmp_path / "child").read_text():
            assert time.monotonic() < deadline
            time.sleep(0.05)
        child = int((tmp_path / "child").read_text())
        os.kill(child, 0)
    finally:
        os.kill(parent.pid, signal.SIGKILL)
        parent.wait()
    deadline = time.monotonic() + 30
    while Path(f"/proc/{child}").exists() and "State:\tZ" not in Path(f"/proc/{child}/status").read_text():
        assert time.monotonic() < deadline, "the child lives on"
        time.sleep(0.05)
