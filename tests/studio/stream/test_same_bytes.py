"""The same splats give the same bytes, whichever kernels OpenBLAS and PyTorch choose for the processor."""

from __future__ import annotations

import os
import platform
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.tiny_capture import ROOT

BAKE = """
import hashlib, sys
from pathlib import Path
import numpy as np
import torch
from studio.gaussians import Gaussians
from studio.stream import BakeSettings, bake_group, write_manifest
from studio.stream.metadata import StreamMetadata
from studio.stream.suggested_view import suggested_view
from tests.support.rigs import ring

folder, generator = Path(sys.argv[1]), np.random.default_rng(0)
base = {name: generator.normal(size=size).astype(np.float32) for name, size in
        (("means", (2000, 3)), ("quats", (2000, 4)), ("log_scales", (2000, 3)), ("sh", (2000, 1, 3)))}
frames = []
for index in range(9):
    moved = {name: torch.from_numpy(values + 0.01 * index * values[::-1]) for name, values in base.items()}
    moved["log_scales"] = 0.3 * moved["log_scales"] - 4
    frames.append(Gaussians(logit_opacities=torch.linspace(-2, 4, 2000), **moved))
group = bake_group(frames, folder, 0, 0, BakeSettings(preset="ultrafast"))
rig = ring(5)
view = suggested_view(rig.cameras[1], group.best.bounding_box.min, group.best.bounding_box.max, rig.up)
write_manifest(folder, [group], 25, BakeSettings(preset="ultrafast"), StreamMetadata(view, up=tuple(rig.up)).to_json())
print(hashlib.sha256((folder / "manifest.json").read_bytes()).hexdigest())
"""


@pytest.mark.skipif(platform.machine() != "x86_64", reason="names of x86 kernels")
def test_the_manifest_does_not_depend_on_the_processor(tmp_path: Path) -> None:
    found = set()
    for kernels, capability in (("Haswell", "avx2"), ("Nehalem", "default")):
        settings = {"OPENBLAS_CORETYPE": kernels, "ATEN_CPU_CAPABILITY": capability, "PYTHONPATH": str(ROOT)}
        command = [sys.executable, "-c", BAKE, str(tmp_path / kernels)]
        done = subprocess.run(command, cwd=ROOT, env={**os.environ, **settings}, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        found.add(done.stdout)
    assert len(found) == 1
