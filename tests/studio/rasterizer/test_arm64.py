"""The kernels on arm64 (NEON) compute what they compute on this machine.

Needs `apt install g++-aarch64-linux-gnu qemu-user-static`: arm64 machines are not among those that run the tests.
"""

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[3]
KERNELS, HERE = ROOT / "studio/rasterizer/csrc", Path(__file__).parent
CROSS, EMULATOR = "aarch64-linux-gnu-g++", "qemu-aarch64-static"
OPTIONS = ["-std=gnu++17", "-O1", "-fno-math-errno", "-fno-trapping-math", "-ffp-contract=fast", "-Wno-psabi"]
SPLATS, PIXELS = 600, 70 * 50  # as in kernel_scene.h
PARTS = {"image": 3 * PIXELS, "alpha": PIXELS, "depth": PIXELS, "radii": SPLATS, "means": 3 * SPLATS}
PARTS |= {"quats": 4 * SPLATS, "log_scales": 3 * SPLATS, "logits": SPLATS, "sh": 12 * SPLATS, "offsets": 2 * SPLATS}

pytestmark = pytest.mark.skipif(
    shutil.which(CROSS) is None or shutil.which(EMULATOR) is None,
    reason=f"{CROSS} or {EMULATOR} is not installed (g++-aarch64-linux-gnu, qemu-user-static)",
)


def results(compiler: str, folder: Path, *emulator: str) -> np.ndarray:
    """The results of kernel_results.cpp, built with a compiler: float64."""
    program = folder / compiler
    sources = [HERE / "kernel_results.cpp"]
    sources += [KERNELS / f"{name}.cpp" for name in ("isa_baseline", "threads", "buffers")]
    command = [compiler, *OPTIONS, "-static", "-pthread", "-I", KERNELS, "-I", HERE, *sources, "-o", program]
    subprocess.run(command, check=True)
    return np.frombuffer(subprocess.run([*emulator, program], check=True, stdout=subprocess.PIPE).stdout, np.float64)


def test_arm64_computes_the_same(tmp_path: Path) -> None:
    """Both passes in double and float, and the loss with its gradient; up to the order in which the compiler adds."""
    arm, here = results(CROSS, tmp_path, EMULATOR), results("g++", tmp_path)
    assert arm.shape == here.shape
    at = 0
    for tolerance in (1e-12, 2e-5):  # double, then float
        for name, size in PARTS.items():
            expected, found = here[at : at + size], arm[at : at + size]
            assert np.abs(expected).max() > 0, name
            assert np.abs(found - expected).max() <= tolerance * np.abs(expected).max(), name
            at += size
    assert np.allclose(arm[at:], here[at:], rtol=1e-4, atol=1e-7)
