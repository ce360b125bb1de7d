"""The same splats give the same bytes, whichever kernels OpenBLAS and PyTorch choose for the processor."""

import hashlib
import os
import platform
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

from tests.support.rigs import ring
from tests.support.tiny_capture import ROOT
from v3studio.studio.gaussians import Gaussians
from v3studio.studio.stream import BakeSettings, bake_group, write_manifest
from v3studio.studio.stream.metadata import StreamMetadata
from v3studio.studio.stream.suggested_view import suggested_view


def bake(folder: Path) -> str:
    """Bake moving splats; returns the hash of the manifest, which has those of the files."""
    generator = np.random.default_rng(0)
    sizes = {"means": (2000, 3), "quats": (2000, 4), "log_scales": (2000, 3), "sh": (2000, 1, 3)}
    base = {name: generator.normal(size=size).astype(np.float32) for name, size in sizes.items()}
    frames = []
    for index in range(9):
        moved = {name: torch.from_numpy(values + 0.01 * index * values[::-1]) for name, values in base.items()}
        moved["log_scales"] = 0.3 * moved["log_scales"] - 4
        frames.append(Gaussians(logit_opacities=torch.linspace(-2, 4, 2000), **moved))
    settings = BakeSettings(preset="ultrafast")
    group = bake_group(frames, folder, 0, 0, settings)
    rig, box = ring(5), group.best.bounding_box
    view = suggested_view(rig.cameras[1], box.min, box.max, rig.up)
    write_manifest(folder, [group], 25, settings, StreamMetadata(view, up=tuple(rig.up)).to_json())
    return hashlib.sha256((folder / "manifest.json").read_bytes()).hexdigest()


@pytest.mark.skipif(platform.machine() != "x86_64", reason="names of x86 kernels")
def test_the_manifest_does_not_depend_on_the_processor(tmp_path: Path) -> None:
    """This processor's kernels, and those of the oldest one."""
    settings = {"OPENBLAS_CORETYPE": "Nehalem", "ATEN_CPU_CAPABILITY": "default", "PYTHONPATH": str(ROOT)}
    command = [sys.executable, __file__, str(tmp_path / "oldest")]
    done = subprocess.run(command, cwd=ROOT, env={**os.environ, **settings}, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == bake(tmp_path / "here")


if __name__ == "__main__":
    print(bake(Path(sys.argv[1])))
