"""Writes requirements.lock, requirements-dev.lock and requirements-docs.lock: all requirements of v3studio, pinned as
installed in .venv.

requirements.lock contains what is needed to run the program and to build its kernels; the others contain what tests and
linters, and the documentation, need in addition. Not included are packages that nothing requires, the dependencies of
torch's CUDA build (pip resolves them when it installs that build), torch's build suffix such as +cpu, and dependencies
that are declared but never imported.

Each version has the SHA-256 of its files on PyPI that fit this project (Linux, CPython 3.11 and newer, and source
archives), for pip's hash checking. Those of open3d-cpu are with open3d, since either is installed. torch has the hashes
of the builds on PyPI, which are for CUDA. Its CPU builds are on PyTorch's own index, whose links tell pip their hashes.
"""

import json
import re
import urllib.request
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path

from packaging.markers import default_environment
from packaging.requirements import Requirement
from packaging.tags import Tag
from packaging.utils import InvalidWheelFilename, canonicalize_name, parse_wheel_filename

ROOT = Path(__file__).resolve().parent.parent
HEADER = "# {what}, pinned: what the tests ran with. Made by `make lock`; pyproject.toml says why.\n"
INDEX = "https://pypi.org/simple/{}/"
MACHINES = ("x86_64", "aarch64")
LEFT_OUT = ("nvidia-", "cuda-", "triton")
# Open3D needs these only in notebooks and in one of its examples; with their dependencies, they are 27 packages.
NOT_IMPORTED = {
    "open3d": {"ipywidgets", "nbformat", "configargparse"},
    "pip-api": {"pip"},  # every environment has one
}


def installed(package: str) -> Distribution:
    """The installed distribution; open3d-cpu is accepted in place of open3d."""
    try:
        return distribution(package)
    except PackageNotFoundError:
        if package != "open3d":
            raise
        return distribution("open3d-cpu")


def needed(name: str, extras: tuple[str, ...]) -> dict[str, str]:
    """Package to version for all dependencies of `name[extras]` on this machine, excluding itself."""
    environment = {key: str(value) for key, value in default_environment().items()}
    found: dict[str, str] = {}
    seen: set[tuple[str, str]] = set()
    waiting = [(name, extra) for extra in ("", *extras)]
    while waiting:
        package, extra = waiting.pop()
        if (package, extra) in seen:
            continue
        seen.add((package, extra))
        info = installed(package)
        if package != name:
            found[package] = info.version.split("+")[0]
        for text in info.requires or ():
            requirement = Requirement(text)
            if requirement.marker is None or requirement.marker.evaluate({**environment, "extra": extra}):
                dependency = canonicalize_name(requirement.name)
                if package != name and dependency.startswith(LEFT_OUT):
                    continue
                if dependency not in NOT_IMPORTED.get(package, ()):
                    waiting += [(dependency, wanted) for wanted in ("", *requirement.extras)]
    return found


def hashes_of(package: str, version: str) -> list[str]:
    """SHA-256 of the files of a version that may be installed on Linux, sorted; from PyPI's JSON index (PEP 691).

    Raises:
        SystemExit: PyPI has no file of this version.
        OSError: PyPI cannot be reached.
    """
    request = urllib.request.Request(INDEX.format(package), headers={"Accept": "application/vnd.pypi.simple.v1+json"})
    with urllib.request.urlopen(request, timeout=60) as answer:
        files = json.load(answer)["files"]
    found = sorted({file["hashes"]["sha256"] for file in files if fits(file["filename"], version)})
    if not found:
        raise SystemExit(f"PyPI has no file of {package} {version} for Linux")
    return found


def fits(file: str, version: str) -> bool:
    """Whether a file on PyPI is a source archive of this version, or a wheel for Linux and CPython 3.11 or newer."""
    try:
        _, found, _, tags = parse_wheel_filename(file)
    except InvalidWheelFilename:
        source = re.fullmatch(r".+-([^-]+)\.tar\.gz", file)
        return source is not None and source[1] == version
    return str(found) == version and any(_fits(tag) for tag in tags)


def _fits(tag: Tag) -> bool:
    linux = tag.platform.startswith(("manylinux", "linux")) and tag.platform.endswith(MACHINES)
    minor = _minor(tag.interpreter)
    python = tag.interpreter.startswith("py3") or minor >= 11 or (minor > 0 and tag.abi == "abi3")
    return (linux or tag.platform == "any") and python and not tag.abi.endswith("t")  # t: without the GIL


def _minor(interpreter: str) -> int:
    found = re.fullmatch(r"cp3(\d+)", interpreter)
    return int(found[1]) if found else 0


def write(file: Path, what: str, packages: dict[str, str]) -> None:
    """Replace `file` atomically."""
    lines = [HEADER.format(what=what)]
    for name, version in sorted(packages.items()):
        hashes = hashes_of(name, version)
        if name == "open3d":
            hashes = sorted({*hashes, *hashes_of("open3d-cpu", version)})
        lines.append(" \\\n    ".join([f"{name}=={version}", *(f"--hash=sha256:{value}" for value in hashes)]) + "\n")
    new = file.with_suffix(".new")
    new.write_text("".join(lines), encoding="utf-8")
    new.replace(file)


if __name__ == "__main__":
    run = needed("v3studio", ("build",))
    write(ROOT / "requirements.lock", "What runs V3 Studio and builds its kernel", run)
    for extra, what in (("dev", "What tests and linters need"), ("docs", "What `make docs` needs")):
        besides = {name: version for name, version in needed("v3studio", (extra,)).items() if name not in run}
        write(ROOT / f"requirements-{extra}.lock", f"{what} besides requirements.lock", besides)
