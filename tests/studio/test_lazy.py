"""Packages whose exports are imported on first use."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

PACKAGES = [
    "studio.calibration",
    "studio.capture",
    "studio.meshing",
    "studio.stream",
    "studio.training",
    "pipelines.config",
]


@pytest.mark.parametrize("package", PACKAGES)
def test_every_export_is_there(package: str) -> None:
    module = __import__(package, fromlist=["__all__"])
    assert module.__all__
    assert set(module.__all__) <= set(dir(module))
    for name in module.__all__:
        getattr(module, name)
    with pytest.raises(AttributeError, match="has no attribute 'nothing'"):
        module.nothing  # noqa: B018


def run(code: str, folder: Path) -> str:
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=60, check=True)
    return done.stdout.strip()


def test_an_export_wins_over_a_submodule_of_its_name(tmp_path: Path) -> None:
    package = tmp_path / "sample"
    package.mkdir()
    (package / "part.py").write_text("def part():\n    return 'open'\n")
    (package / "__init__.py").write_text(
        "from typing import TYPE_CHECKING\nfrom studio.lazy import lazy_exports\n"
        "if TYPE_CHECKING:\n    from sample.part import part\nlazy_exports(__name__)\n"
    )
    root = str(Path(__file__).parents[2])
    head = f"import sys; sys.path[:0] = [{root!r}, '.']; "
    assert run(f"{head}import sample; print('sample.part' in sys.modules)", tmp_path) == "False"
    assert run(f"{head}from sample import part; print(part())", tmp_path) == "open"
    assert run(f"{head}import sample.part; from sample import part; print(part())", tmp_path) == "open"
