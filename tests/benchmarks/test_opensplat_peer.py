"""What is given to OpenSplat's rasterizer, which is not here."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

from studio.cameras import Camera

ROOT = Path(__file__).parents[2]


def test_a_folder_without_opensplat_is_refused(tmp_path: Path) -> None:
    command = [sys.executable, "benchmarks/rasterizer.py", "--quick", "--opensplat", str(tmp_path)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 1
    assert f"{tmp_path}/rasterizer/gsplat-cpu/gsplat_cpu.cpp is missing" in done.stderr
    assert "Traceback" not in done.stderr


def test_its_matrices_project_as_the_camera_does(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    import opensplat_peer

    pose = np.eye(4)
    pose[:3, :3] = [[0.8, 0, 0.6], [0, 1, 0], [-0.6, 0, 0.8]]
    pose[:3, 3] = (0.1, -0.2, 3.0)
    K = np.array([[500.0, 0, 310], [0, 520.0, 190], [0, 0, 1]])
    camera = Camera("a", 640, 360, K, pose)
    _, matrix = opensplat_peer._matrices(camera)
    points = np.random.default_rng(0).uniform(-0.5, 0.5, (20, 3))
    clip = (matrix.double() @ torch.from_numpy(np.c_[points, np.ones(20)]).T).T.numpy()
    ndc = clip[:, :3] / clip[:, 3:]
    found = 0.5 * (ndc[:, :2] + 1) * (640, 360)
    seen = points @ pose[:3, :3].T + pose[:3, 3]
    wanted = (seen @ K.T)[:, :2] / seen[:, 2:]
    np.testing.assert_allclose(found, wanted, atol=1e-3)
    order = np.argsort(seen[:, 2])
    assert (np.diff(ndc[order, 2]) > 0).all()  # farther is larger
