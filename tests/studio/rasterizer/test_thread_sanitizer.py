"""The thread pool and the kernels under ThreadSanitizer, in a C++ program: Python itself would give false reports."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
RACE_FOUND = 66
"""Exit code of a program in which ThreadSanitizer found a data race."""

pytestmark = [pytest.mark.slow, pytest.mark.timeout(1800)]  # compiling takes minutes on a busy machine


def tool(name: str) -> str:
    found = shutil.which(name, path=f"{Path(sys.executable).parent}{os.pathsep}{os.environ.get('PATH', '')}")
    if found is None:
        pytest.skip(f"{name} is not installed")
    return found


def run(program: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    # without address space randomization: the shadow memory of older sanitizers collides with random addresses
    command = [tool("setarch"), "--addr-no-randomize", str(program), *arguments]
    environment = {name: value for name, value in os.environ.items() if name != "TSAN_OPTIONS"}
    return subprocess.run(command, capture_output=True, text=True, env=environment, check=False)


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The program of `make tsan`."""
    folder = tmp_path_factory.mktemp("tsan")
    compiler = os.environ.get("CXX") or tool("c++")
    probe = folder / "probe.cpp"
    probe.write_text("int main() { return 0; }\n", encoding="utf-8")
    built = subprocess.run([compiler, "-fsanitize=thread", str(probe), "-o", str(folder / "probe")], check=False)
    if built.returncode != 0 or run(folder / "probe").returncode != 0:
        pytest.skip(f"{compiler} does not support -fsanitize=thread here")
    build = folder / "build"
    tool("ninja")
    for command in (
        [tool("cmake"), "-S", str(ROOT), "-B", str(build), "-G", "Ninja", "-DV3STUDIO_TSAN=ON"],
        [tool("cmake"), "--build", str(build)],
    ):
        environment = os.environ | {"PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ.get('PATH', '')}"}
        done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
    return build / "kernels_tsan"


def test_kernels_have_no_data_race(program: Path) -> None:
    done = run(program)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "baseline: no lost task, same bits" in done.stdout


def test_the_sanitizer_finds_a_race_made_on_purpose(program: Path) -> None:
    done = run(program, "race")
    assert done.returncode == RACE_FOUND
    assert "data race" in done.stderr
