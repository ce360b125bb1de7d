"""The self-test of the setup: problems that it detects, and its report."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import sysconfig
from importlib.machinery import EXTENSION_SUFFIXES
from importlib.metadata import packages_distributions
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).parents[2]
SITE = Path(sysconfig.get_path("platlib"))
C_LIBRARY = re.compile(r"^(ld-linux.*|lib(c|m|dl|pthread|rt|resolv|mvec)\.so\.\d+)$")  # libc6 is always installed

needs_compiler = pytest.mark.skipif(shutil.which("g++") is None, reason="g++ is not installed")


def build_library(path: Path, *needs: Path) -> None:
    """A shared library without code that depends on others."""
    path.parent.mkdir(parents=True, exist_ok=True)
    command = ["g++", "-shared", "-nostdlib", "-x", "c", "/dev/null", "-o", path, f"-Wl,-soname,{path.name}"]
    subprocess.run([*command, "-x", "none", "-Wl,--no-as-needed", *needs], check=True)


def test_the_list_is_read(self_test: ModuleType) -> None:
    script = (
        'need "python$version-venv" can_make_venv\n'
        "need libgl1 library libGL.so.1 # open3d\n"
        "    need a-1 library liba.so\n"
        "need xvfb program Xvfb\n"
    )
    assert self_test.listed_libraries(script) == {"libGL.so.1": "libgl1", "liba.so": "a-1"}


def test_every_library_that_the_environment_needs_is_in_the_list_of_system_packages(self_test: ModuleType) -> None:
    outside = self_test.outside_libraries(SITE)
    listed = self_test.listed_libraries((ROOT / "scripts" / "system_packages.sh").read_text(encoding="utf-8"))
    unlisted = {name: users for name, users in outside.items() if name not in listed and not C_LIBRARY.match(name)}
    assert not unlisted
    assert {"libGL.so.1", "libOpenGL.so.0", "libusb-1.0.so.0"} <= set(outside)


@pytest.mark.skipif(shutil.which("readelf") is None, reason="readelf is not installed")
def test_needed_libraries_are_those_of_readelf(self_test: ModuleType) -> None:
    files = [path for path in SITE.rglob("*.so*") if path.is_file()]
    for path in sorted(files)[:: max(1, len(files) // 25)]:
        listing = subprocess.run(["readelf", "-d", path], capture_output=True, text=True, check=False).stdout
        assert self_test.needed_libraries(path) == re.findall(r"\(NEEDED\).*\[(.*)\]", listing), path


def test_a_text_file_needs_no_library(self_test: ModuleType, tmp_path: Path) -> None:
    (tmp_path / "libc.so").write_text("/* GNU ld script */")
    (tmp_path / "empty.so").write_bytes(b"")
    assert self_test.needed_libraries(tmp_path / "libc.so") == []
    assert self_test.needed_libraries(tmp_path / "empty.so") == []


@needs_compiler
def test_libraries_are_followed_through_bundled_ones_and_only_those_that_are_loaded(
    self_test: ModuleType, tmp_path: Path
) -> None:
    nowhere = tmp_path / "gone" / "libnowhere.so.7"
    elsewhere = tmp_path / "gone" / "libelsewhere.so.1"
    build_library(nowhere)
    build_library(elsewhere)
    site = tmp_path / "site"
    build_library(site / "one.libs" / "libinner.so.2", nowhere)
    build_library(site / "one" / f"core{EXTENSION_SUFFIXES[0]}", site / "one.libs" / "libinner.so.2")
    build_library(site / "one" / "optional_ops.so", elsewhere)
    build_library(site / "two" / "plugins" / "filter.so", elsewhere)
    assert self_test.outside_libraries(site, plugins=()) == {"libnowhere.so.7": {"one"}}
    plugins = ["two/plugins/*.so"]
    assert self_test.outside_libraries(site, plugins) == {"libnowhere.so.7": {"one"}, "libelsewhere.so.1": {"two"}}
    assert self_test.not_found(["libc.so.6", "libnowhere.so.7"]) == ["libnowhere.so.7"]


@pytest.mark.parametrize(
    ("library", "package"),
    [
        ("libOpenGL.so.0", "libopengl0"),
        ("libusb-1.0.so.0", "libusb-1.0-0"),
        ("libcom_err.so.2", "libcom-err2"),
        ("libz.so.1", "zlib1g"),
    ],
)
def test_debian_packages_are_listed_ones_or_follow_the_naming_rule(
    self_test: ModuleType, library: str, package: str
) -> None:
    assert self_test.debian_package(library, {"libz.so.1": "zlib1g"}) == package


def test_modules_of_all_dependencies_are_known(self_test: ModuleType) -> None:
    names = self_test.dependencies((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    assert "torch" in names
    installed = {
        (distribution.lower(), module) for module, names in packages_distributions().items() for distribution in names
    }

    def top(name: str) -> str:
        return self_test.module_of(name).partition(".")[0]

    # open3d-cpu contains the same module as open3d.
    unknown = [name for name in names if not {(name, top(name)), (f"{name}-cpu", top(name))} & installed]
    assert not unknown


def test_a_package_that_is_not_installed_is_named(self_test: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "yaml", None)
    with pytest.raises(RuntimeError, match="package pyyaml is not installed; run `make setup`"):
        self_test.import_module("pyyaml")


def test_a_kernel_that_draws_something_else_is_found(self_test: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    import studio.rasterizer

    right = studio.rasterizer.rasterize

    def rasterize(splats, camera, *, backend):
        moved = splats if backend == "reference" else splats.map(lambda tensor: tensor * 1.1)
        return right(moved, camera, backend="reference")

    monkeypatch.setattr(studio.rasterizer, "rasterize", rasterize)
    with pytest.raises(RuntimeError, match="differs from the reference"):
        self_test.check_kernel()


def test_a_missing_library_is_one_sentence_and_explains_its_packages_failures(self_test: ModuleType) -> None:
    failures = {
        "decimating a mesh with pymeshlab": "AttributeError: no such filter",
        "importing av": "libx.so.1 was not found; install libx1 (Debian, Ubuntu)",
    }
    assert self_test.sentences({"libOpenGL.so.0": {"pymeshlab"}}, failures, {"libOpenGL.so.0": "libopengl0"}) == [
        "libOpenGL.so.0, required by pymeshlab, was not found; install libopengl0 (Debian, Ubuntu).",
        "Importing av failed: libx.so.1 was not found; install libx1 (Debian, Ubuntu).",
    ]


def run_self_test(**variables: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, ROOT / "scripts" / "self_test.py"],
        env={**os.environ, **variables},
        capture_output=True,
        text=True,
        timeout=300,
    )


def test_all_is_well_in_one_line() -> None:
    done = run_self_test()
    assert done.returncode == 0, done.stderr
    assert re.fullmatch(r"Self-test: \d+ checks passed in \d+ s\n", done.stdout)
    assert done.stderr == ""


def test_everything_that_is_missing_is_named(tmp_path: Path) -> None:
    (tmp_path / "plyfile.py").write_text(
        "raise ImportError('libfoo.so.3: cannot open shared object file: No such file or directory')"
    )
    (tmp_path / "scipy.py").write_text("raise ModuleNotFoundError(\"No module named 'scipy'\", name='scipy')")
    # Like C++ code, bypasses sys.stdout, then aborts.
    (tmp_path / "pymeshlab.py").write_text("import os; os.write(1, b'Warning: noise\\n'); os.abort()")
    # Simulates a machine without a Vulkan driver.
    done = run_self_test(PYTHONPATH=str(tmp_path), VK_ICD_FILENAMES="/none.json", VK_DRIVER_FILES="/none.json")
    assert done.returncode == 1
    assert done.stdout == ""
    found = done.stderr.splitlines()
    expected = [
        "Importing scipy failed: the Python package scipy is not installed",
        "Importing pymeshlab failed: it ended the process with signal SIGABRT",
        "Importing bjontegaard failed: ModuleNotFoundError: No module named 'scipy'",
        "Importing plyfile failed: libfoo.so.3 was not found; install libfoo3",
        "Decimating a mesh with pymeshlab failed: it ended the process with signal SIGABRT",
        "Opening Vulkan failed: the window needs Vulkan",
    ]
    assert len(found) == len(expected), done.stderr
    for line, beginning in zip(found, expected, strict=True):
        assert line.startswith(beginning)
    assert "mesa-vulkan-drivers" in found[-1]
