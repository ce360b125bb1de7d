"""The set-up of .venv: what it installs, when it does nothing, and how it recovers. pip is replaced by a program that
writes down its arguments."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

PYTHON = f"""#!/bin/bash
# Stands in for python3 and, within .venv, for its Python.
if [ "$1 $2" = "-m venv" ]; then
    mkdir -p "$3/bin" && cp "$0" "$3/bin/python" && echo "#!$PWD/$3/bin/python" >"$3/bin/pip"
    echo "venv $3" >>log
elif [ "$1 $2" = "-m pip" ]; then
    shift 2
    echo "pip $*" >>log
    for word in "$@"; do [ ! -f "$word" ] || cp "$word" "list-$(grep -c ^pip log)"; done
    ! grep -qxF -- "$FAIL_ON" <<<"$(printf '%s\\n' "$@")"
elif [[ "$2" == *metadata* ]]; then
    exit 1
elif [[ "$2" == *_base_executable* ]]; then
    echo "$PWD/python3"
else
    exec "{sys.executable}" "$@"
fi
"""
LOCK = """numpy==2.0 \\
    --hash=sha256:aa
open3d==0.20.0 \\
    --hash=sha256:bb
open3d-cpu==0.20.0 \\
    --hash=sha256:cc
"""


@pytest.fixture
def folder(clone: Path) -> Path:
    (clone / "python3").write_text(PYTHON)
    (clone / "python3").chmod(0o755)
    (clone / "requirements.lock").write_text(LOCK + "torch==2.13.0 \\\n    --hash=sha256:dd\n")
    (clone / "requirements-dev.lock").write_text("pytest==8.0 \\\n    --hash=sha256:ee\n")
    for package in ("studio/rasterizer", "pipelines", "gui", "v3studio"):
        (clone / package).mkdir(parents=True)
    (clone / "studio" / "rasterizer" / "a.cpp").write_text("int a;\n")
    for name in ("pyproject.toml", "CMakeLists.txt"):
        (clone / name).write_text(name)
    return clone


def setup(folder: Path, *arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    (folder / "log").write_text("")
    env = {"FAIL_ON": "", "V3STUDIO_TORCH": "cpu", **os.environ, "PYTHON": f"{folder}/python3", **environment}
    command = ["bash", "scripts/setup.sh", *arguments]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, env=env)


def log(folder: Path) -> list[str]:
    return (folder / "log").read_text().splitlines()


def test_everything_is_installed_once_and_again_only_if_it_changes(folder: Path) -> None:
    ended = setup(folder, "dev")
    assert ended.returncode == 0, ended.stderr
    venv, torch, locked, dev, package = log(folder)
    assert venv == "venv .venv"
    assert "torch==2.13.0+cpu" in torch
    assert all("--require-hashes" in line for line in (locked, dev))
    assert "--editable ." in package
    unwanted = "open3d" if os.uname().machine == "x86_64" else "open3d-cpu"
    wanted = (folder / "list-2").read_text()
    assert "numpy==2.0 \\\n    --hash=sha256:aa\n" in wanted
    assert f"{unwanted}==" not in wanted
    assert "torch" not in wanted

    assert setup(folder, "dev").returncode == 0
    assert log(folder) == []
    (folder / "studio" / "rasterizer" / "a.cpp").write_text("int b;\n")
    assert setup(folder, "dev").returncode == 0
    assert [line.split()[-1] for line in log(folder)] == ["."]
    (folder / "requirements-dev.lock").write_text("pytest==8.1 \\\n    --hash=sha256:ff\n")
    assert setup(folder).returncode == 0
    assert log(folder) == []
    assert setup(folder, "dev").returncode == 0
    assert len(log(folder)) == 1


def test_without_a_cpu_build_pip_chooses_one(folder: Path) -> None:
    ended = setup(folder, FAIL_ON="torch==2.13.0+cpu")
    assert ended.returncode == 0, ended.stderr
    assert log(folder)[2].endswith("torch==2.13.0")


def test_a_failed_or_interrupted_installation_begins_with_a_new_venv(folder: Path) -> None:
    failed = setup(folder, FAIL_ON="--require-hashes")
    assert failed.returncode == 1
    assert "requirements could not be installed" in failed.stderr
    ended = setup(folder)
    assert ended.returncode == 0
    assert "interrupted" in ended.stdout
    assert log(folder)[0] == "venv .venv"


@pytest.mark.parametrize("damage", ["moved", "no python", "other torch"])
def test_an_unusable_venv_is_created_again(folder: Path, damage: str) -> None:
    assert setup(folder).returncode == 0
    if damage == "moved":
        (folder / ".venv" / "bin" / "pip").write_text("#!/elsewhere/.venv/bin/python")
    elif damage == "no python":
        (folder / ".venv" / "bin" / "python").unlink()
    ended = setup(folder, **({"V3STUDIO_TORCH": "cuda"} if damage == "other torch" else {}))
    assert ended.returncode == 0, ended.stderr
    assert ended.stdout.startswith("Recreating .venv")
    assert log(folder)[0] == "venv .venv"
    if damage == "other torch":
        assert log(folder)[1].endswith("torch===2.13.0")
        assert setup(folder, V3STUDIO_TORCH="").returncode == 0  # later runs keep it
        assert log(folder) == []


def test_an_unknown_build_of_torch_is_rejected(folder: Path) -> None:
    ended = setup(folder, V3STUDIO_TORCH="rocm")
    assert ended.returncode == 1
    assert "'rocm'" in ended.stderr
    assert not (folder / ".venv").exists()
