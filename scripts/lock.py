"""Writes requirements.lock and requirements-dev.lock: all requirements of v3studio, pinned as installed in .venv.

requirements.lock contains what is needed to run the program and to build its kernels; requirements-dev.lock contains
what tests and linters need in addition. Not included are packages that nothing requires, the dependencies of torch's
CUDA build (pip resolves them when it installs that build), torch's build suffix such as +cpu, and dependencies that are
declared but never imported.
"""

from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path

from packaging.markers import default_environment
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).resolve().parent.parent
HEADER = "# {what}, pinned: what the tests ran with. Made by `make lock`; pyproject.toml says why.\n"
LEFT_OUT = ("nvidia-", "cuda-", "triton")
# Open3D needs these only in notebooks and in one of its examples; with their dependencies, they are 27 packages.
NOT_IMPORTED = {"open3d": {"ipywidgets", "nbformat", "configargparse"}}


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
                if not dependency.startswith(LEFT_OUT) and dependency not in NOT_IMPORTED.get(package, ()):
                    waiting += [(dependency, wanted) for wanted in ("", *requirement.extras)]
    return found


def write(file: Path, what: str, packages: dict[str, str]) -> None:
    """Replace `file` atomically."""
    new = file.with_suffix(".new")
    new.write_text(
        HEADER.format(what=what) + "".join(f"{name}=={version}\n" for name, version in sorted(packages.items())),
        encoding="utf-8",
    )
    new.replace(file)


if __name__ == "__main__":
    run = needed("v3studio", ("build",))
    dev = {name: version for name, version in needed("v3studio", ("dev",)).items() if name not in run}
    write(ROOT / "requirements.lock", "What runs V3 Studio and builds its kernel", run)
    write(ROOT / "requirements-dev.lock", "What tests and linters need besides requirements.lock", dev)
