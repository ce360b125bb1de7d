"""Prints requirements.lock: v3studio[dev] and all that it needs, pinned as installed in the running environment.

Packages that happen to be installed but are needed by nothing are left out, and so are what torch's CUDA build brings
(pip finds those by itself on a machine whose torch is that build) and torch's build suffix such as +cpu.
"""

from importlib.metadata import distribution

from packaging.markers import default_environment
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

HEADER = "# Every package of the set-up, pinned: what the tests ran with. Made by `make lock`; pyproject.toml says why."
LEFT_OUT = ("nvidia-", "cuda-", "triton")


def needed(name: str, extras: tuple[str, ...]) -> dict[str, str]:
    """{package: version} of everything that `name[extras]` needs here, without itself."""
    environment = {key: str(value) for key, value in default_environment().items()}
    found: dict[str, str] = {}
    seen: set[tuple[str, str]] = set()
    waiting = [(name, extra) for extra in ("", *extras)]
    while waiting:
        package, extra = waiting.pop()
        if (package, extra) in seen:
            continue
        seen.add((package, extra))
        info = distribution(package)
        if package != name:
            found[canonicalize_name(info.metadata["Name"])] = info.version.split("+")[0]
        for text in info.requires or ():
            requirement = Requirement(text)
            if requirement.marker is None or requirement.marker.evaluate({**environment, "extra": extra}):
                dependency = canonicalize_name(requirement.name)
                if not dependency.startswith(LEFT_OUT):
                    waiting += [(dependency, wanted) for wanted in ("", *requirement.extras)]
    return found


if __name__ == "__main__":
    print(HEADER)
    for package, version in sorted(needed("v3studio", ("dev",)).items()):
        print(f"{package}=={version}")
