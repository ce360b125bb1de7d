"""Uncertainties of cameras, compared with the errors of solutions of synthetic rigs."""

import numpy as np
import pytest

from tests.studio.calibration.sfm.jobs import job_of, rig_of
from v3studio.studio.calibration import compare_rigs
from v3studio.studio.calibration.sfm.bundle_adjustment import adjust
from v3studio.studio.calibration.sfm.uncertainty import uncertainties

pycolmap = pytest.importorskip("pycolmap")

CAMERAS, TRIALS = 8, 6
JOB = job_of(CAMERAS, attempts=("incremental",))


def solved(seed: int) -> tuple[object, object]:
    """A rig with 0.5 pixels of noise, solved from the truth; and the truth."""
    pycolmap.set_random_seed(seed)
    options = pycolmap.SyntheticDatasetOptions(num_rigs=CAMERAS, num_cameras_per_rig=1, num_frames_per_rig=1)
    options.num_points3D = 300
    truth = pycolmap.synthesize_dataset(options)
    model = pycolmap.Reconstruction(truth)
    pycolmap.synthesize_noise(pycolmap.SyntheticNoiseOptions(point2D_stddev=0.5), model)
    adjust(model, JOB)
    return model, truth


def test_errors_are_as_large_as_the_uncertainty_says() -> None:
    ratios = []
    for seed in range(TRIALS):
        model, truth = solved(seed + 1)
        rig = rig_of(truth)
        points = np.array([point.xyz for point in truth.points3D.values()])
        distance = np.mean([np.linalg.norm(points - camera.center, axis=1).mean() for camera in rig])
        off = compare_rigs(rig_of(model), rig)
        for image, (position, degrees) in uncertainties(model, JOB, centers=False).items():
            name = str(image - 1)
            ratios.append((off.centers[name] / distance / position, off.rotations[name] / degrees))
    assert len(ratios) == CAMERAS * TRIALS
    assert np.sqrt(np.mean(np.square(ratios), axis=0)) == pytest.approx([1, 1], abs=0.35)


def test_a_camera_with_few_points_is_uncertain_and_fixed_poses_are_not() -> None:
    model, _ = solved(1)
    before = uncertainties(model, JOB, centers=False)
    seen = [n for n, point in enumerate(model.images[3].points2D) if point.has_point3D()]
    for index in seen[30:]:
        model.delete_observation(3, index)
    after = uncertainties(model, JOB, centers=False)
    assert after[3][0] > 2 * before[3][0]
    assert max(after, key=lambda image: after[image][0]) == 3
    free = uncertainties(model, JOB, centers=True)
    assert np.mean([free[image][1] / after[image][1] for image in free]) > 1.5, "principal points trade with turns"
    poses = [camera.world_to_camera[:3].tolist() for camera in rig_of(model)]
    assert uncertainties(model, JOB.model_copy(update={"poses": poses, "fix_poses": True}), centers=False) == {}
