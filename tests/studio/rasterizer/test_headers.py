"""Each kernel header compiles on its own, so that clangd and other tools can read it."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest

CSRC = Path(__file__).parents[3] / "studio" / "rasterizer" / "csrc"
OPTIONS = ("-std=gnu++17", "-fsyntax-only", "-Wall", "-Wextra", "-Werror", "-Wno-psabi", "-Wno-unused-function")


@pytest.mark.parametrize("header", sorted(path.name for path in CSRC.glob("*.h")))
def test_a_header_includes_what_it_uses(header: str) -> None:
    compiler = os.environ.get("CXX") or shutil.which("c++") or shutil.which("g++") or shutil.which("clang++")
    if compiler is None:
        pytest.skip("no C++ compiler is installed")
    done = subprocess.run(
        [compiler, *OPTIONS, f"-I{CSRC}", "-x", "c++", "-"],
        input=f'#include "{header}"\n',
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
