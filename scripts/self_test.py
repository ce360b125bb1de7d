"""Checks that the environment of the running Python has everything that V3 Studio needs; the last step of `make setup`.

    .venv/bin/python scripts/self_test.py

Looks for the shared libraries that compiled modules and plugins need, imports every dependency declared in
pyproject.toml, calls a mesh filter, encodes and decodes a video frame, lists the Vulkan devices, and compares the CPU
rasterizer with the reference. If all checks pass, it prints one line and exits with 0. Otherwise, it prints one
sentence per problem, with the Debian package to install if it is known, and exits with 1.

The checks run in two child processes, so that a library that aborts does not end the report. The output of libraries is
shown only if a check fails without an error message.
"""

from __future__ import annotations

import importlib
import json
import os
import re
import signal
import struct
import subprocess
import sys
import sysconfig
import time
import tomllib
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from importlib.machinery import EXTENSION_SUFFIXES
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SYSTEM_PACKAGES = ROOT / "scripts" / "system_packages.sh"
MODULES = {"opencv-contrib-python-headless": "cv2", "pillow": "PIL", "pyyaml": "yaml", "ruamel.yaml": "ruamel.yaml"}
"""Modules of the distributions whose name differs from that of the distribution."""

PLUGINS = ("pymeshlab/lib/plugins/*.so",)
"""Compiled files, relative to site-packages, that are not modules but are loaded at run time by their package.

Not every compiled file is needed: for example, open3d_tf_ops.so and open3d_torch_ops.so are loaded only by open3d.ml,
which is not used and needs TensorFlow and CUDA.
"""


# Shared libraries


def listed_libraries(script: str) -> dict[str, str]:
    """Library to Debian package, from the lines `need PACKAGE library LIBRARY` in scripts/system_packages.sh."""
    found = re.findall(r"^\s*need\s+(\S+)\s+library\s+(\S+)", script, re.MULTILINE)
    return {library: package.strip("\"'") for package, library in found}


def debian_package(library: str, listed: dict[str, str]) -> str:
    """The Debian package of a shared library: as listed, or by the naming rule of Debian Policy, section 8.1."""
    if library in listed:
        return listed[library]
    name, _, version = library.partition(".so.")
    separator = "-" if name[-1].isdigit() and version[:1].isdigit() else ""
    return f"{name}{separator}{version}".lower().replace("_", "-")


def needed_libraries(path: Path) -> list[str]:
    """The DT_NEEDED entries of a 64-bit little-endian ELF file; empty for any other file.

    Source: System V ABI, chapters 4 (header) and 5 (program header, dynamic section).
    """
    with open(path, "rb") as file:
        if file.read(6) != b"\x7fELF\x02\x01":  # 64-bit, little-endian
            return []
        file.seek(0x20)
        (table,) = struct.unpack("<Q", file.read(8))
        file.seek(0x36)
        entry_bytes, entries = struct.unpack("<HH", file.read(4))
        segments, dynamic = [], None
        for index in range(entries):
            file.seek(table + index * entry_bytes)
            kind, _, offset, address, _, size = struct.unpack("<IIQQQQ", file.read(40))
            if kind == 1:  # PT_LOAD
                segments.append((address, size, offset))
            elif kind == 2:  # PT_DYNAMIC
                dynamic = (offset, size)
        if dynamic is None:
            return []
        file.seek(dynamic[0])
        data = file.read(dynamic[1])
        tags = list(struct.iter_unpack("<qQ", data[: len(data) // 16 * 16]))
        address = next((value for tag, value in tags if tag == 5), None)  # DT_STRTAB
        start = next((o + address - a for a, size, o in segments if address is not None and a <= address < a + size), 0)
        names = []
        for tag, value in tags:
            if tag == 0:  # DT_NULL
                break
            if tag == 1:  # DT_NEEDED
                file.seek(start + value)
                names.append(file.read(512).split(b"\0", 1)[0].decode())
        return names


def outside_libraries(site: Path, plugins: Iterable[str] = PLUGINS) -> dict[str, set[str]]:
    """Shared libraries that are not in site-packages, with the packages whose modules load them.

    Follows the dependencies of modules and plugins, including those of the bundled libraries that they load. Bundled
    libraries that nothing loads are ignored.
    """
    files = [path for path in site.rglob("*.so*") if path.is_file()]
    bundled: dict[str, list[Path]] = {}
    for path in files:
        bundled.setdefault(path.name, []).append(path)
    suffixes = tuple(suffix for suffix in EXTENSION_SUFFIXES if suffix != ".so")
    waiting = [path for path in files if path.name.endswith(suffixes)]
    waiting += [path for pattern in plugins for path in site.glob(pattern)]
    outside: dict[str, set[str]] = {}
    seen = set(waiting)
    while waiting:
        path = waiting.pop()
        package = _package(path, site)
        for library in needed_libraries(path):
            copies = bundled.get(library)
            if copies is None:
                outside.setdefault(library, set()).add(package)
                continue
            copy = next((copy for copy in copies if _package(copy, site) == package), copies[0])
            if copy not in seen:
                seen.add(copy)
                waiting.append(copy)
    return outside


def _package(path: Path, site: Path) -> str:
    """Top-level folder (or module) in site-packages; wheels store the libraries of `package` in package.libs."""
    return path.relative_to(site).parts[0].split(".")[0]


def not_found(libraries: Iterable[str]) -> list[str]:
    """The libraries that the dynamic loader does not find, tested in a child process."""
    code = (
        "import ctypes, sys\nfor name in sys.argv[1:]:\n    try: ctypes.CDLL(name)\n    except OSError: print(name)\n"
    )
    names = sorted(libraries)
    done = subprocess.run([sys.executable, "-c", code, *names], capture_output=True, text=True, timeout=60)
    if done.returncode != 0:
        raise RuntimeError(f"the check for shared libraries ended with status {done.returncode}: {done.stderr.strip()}")
    return done.stdout.split()


# Checks


@dataclass(frozen=True)
class Check:
    """One check.

    Attributes:
        does: what it does, as a gerund phrase, used in "... failed".
        uses: top-level modules that it uses; if one of them lacks a shared library, that explains a failure.
        run: performs the check; raises an exception if it fails.
    """

    does: str
    uses: tuple[str, ...]
    run: Callable[[], None]


def dependencies(pyproject: str) -> list[str]:
    """Names of the distributions in project.dependencies."""
    requirements = tomllib.loads(pyproject)["project"]["dependencies"]
    return [re.match(r"[A-Za-z0-9._-]+", requirement).group().lower() for requirement in requirements]


def module_of(distribution: str) -> str:
    """The module to import for a distribution."""
    return MODULES.get(distribution, distribution.replace("-", "_"))


def check_mesh_filter() -> None:
    """Halve the faces of a small sphere. The filter is in a plugin that is not loaded if it lacks a shared library."""
    import pymeshlab

    meshes = pymeshlab.MeshSet()
    meshes.create_sphere(subdiv=2)
    before = meshes.current_mesh().face_number()
    meshes.meshing_decimation_quadric_edge_collapse(targetfacenum=before // 2)
    after = meshes.current_mesh().face_number()
    if not 0 < after <= before // 2:
        raise RuntimeError(f"{before} faces were reduced to {after}, expected at most {before // 2}")


def check_video() -> None:
    """Encode a gradient with libx264, decode it, and compare luma."""
    import io

    import av
    import numpy as np

    picture = np.full((96, 64), 128, np.uint8)  # 4:2:0: 64 rows of luma, 32 of chroma
    picture[:64] = np.linspace(32, 224, 64)[:, None]
    file = io.BytesIO()
    with av.open(file, "w", format="mp4") as out:
        stream = out.add_stream("libx264", rate=30, options={"qp": "20"})
        stream.width, stream.height, stream.pix_fmt = 64, 64, "yuv420p"
        out.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="yuv420p")))
        out.mux(stream.encode(None))
    with av.open(io.BytesIO(file.getvalue())) as container:
        decoded = next(container.decode(video=0)).to_ndarray()
    error = float(np.abs(decoded[:64].astype(float) - picture[:64]).mean())
    if error > 4:
        raise RuntimeError(f"the decoded frame differs from the encoded frame by {error:.1f} of 255 levels on average")


def check_vulkan() -> None:
    """Create a Vulkan instance and list its devices, as the window does before it opens."""
    from gui.platform.vulkan import vulkan_devices

    vulkan_devices()


def check_kernel() -> None:
    """Render ten splats with the CPU kernels and with the reference."""
    import numpy as np
    import torch

    from studio.cameras import Camera
    from studio.gaussians import Gaussians
    from studio.rasterizer import rasterize

    generator = torch.Generator().manual_seed(0)
    splats = Gaussians(
        means=torch.randn(10, 3, generator=generator) * 0.3,
        quats=torch.randn(10, 4, generator=generator),
        log_scales=torch.randn(10, 3, generator=generator) * 0.3 - 2.0,
        logit_opacities=torch.randn(10, generator=generator),
        sh=torch.randn(10, 4, 3, generator=generator) * 0.3,
    )
    pose = np.eye(4)
    pose[2, 3] = 3.0
    camera = Camera("self-test", 64, 48, np.array([[50.0, 0, 32], [0, 50.0, 24], [0, 0, 1]]), pose)
    drawn = rasterize(splats, camera, backend="cpu").image
    expected = rasterize(splats, camera, backend="reference").image
    difference = (drawn - expected).abs()
    # Due to rounding, a pixel may be on the other side of the alpha threshold of 1/255.
    if expected.max() < 0.1 or difference.mean() > 1e-4 or difference.max() > 0.02:
        raise RuntimeError(f"the image differs from the reference by up to {float(difference.max()):.3f}")


def groups() -> tuple[list[Check], list[Check]]:
    """All checks, in two groups that take about the same time; torch takes half of the total."""
    imports = [
        Check(f"importing {name}", (module_of(name),), lambda name=name: import_module(name))
        for name in dependencies((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    ]
    heavy = [check for check in imports if check.uses[0] in ("torch", "scipy", "matplotlib")]
    kernel = Check("rendering with the CPU kernels", ("torch", "studio"), check_kernel)
    others = [check for check in imports if check not in heavy]
    mesh_filter = Check("decimating a mesh with pymeshlab", ("pymeshlab",), check_mesh_filter)
    video = Check("encoding an H.264 frame with av", ("av",), check_video)
    vulkan = Check("opening Vulkan", (), check_vulkan)
    return [*heavy, kernel], [*others, mesh_filter, video, vulkan]


def import_module(distribution: str) -> None:
    """Import the module of a distribution.

    Raises:
        RuntimeError: the module itself is not installed.
    """
    module = module_of(distribution)
    try:
        importlib.import_module(module)
    except ModuleNotFoundError as error:
        if error.name != module:
            raise
        raise RuntimeError(f"the Python package {distribution} is not installed; run `make setup`") from None


def explain(error: BaseException, listed: dict[str, str]) -> str:
    """The text of an exception on one line, with the Debian package if it names a missing shared library."""
    text = " ".join(str(error).split()) or type(error).__name__
    library = re.search(r"(\S+\.so[.0-9]*): cannot open shared object file", text)
    if library:
        return f"{library[1]} was not found; install {debian_package(library[1], listed)} (Debian, Ubuntu)"
    known = isinstance(error, RuntimeError) or type(error).__name__ == "StudioError"
    return text if known else f"{type(error).__name__}: {text}"


def run_group(group: list[Check], report: Callable[[str, str], None], listed: dict[str, str]) -> None:
    """Run checks one after the other; reports ("begin", check) before each and ("failed", reason) if it fails."""
    for check in group:
        report("begin", check.does)
        try:
            check.run()
        except Exception as error:
            report("failed", explain(error, listed))


# Report


def child(index: int, first: int) -> None:
    """Run a group, starting at check `first`; standard output contains only its report, whatever C++ code prints."""
    reports = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)

    def report(kind: str, text: str) -> None:
        print(json.dumps([kind, text]), file=reports, flush=True)

    run_group(groups()[index][first:], report, listed_libraries(SYSTEM_PACKAGES.read_text(encoding="utf-8")))


def start_child(index: int, first: int = 0) -> subprocess.Popen[str]:
    """A child process that runs `child(index, first)`."""
    return subprocess.Popen(
        [sys.executable, __file__, str(index), str(first)],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        errors="replace",
        cwd=ROOT,
    )


def collect(index: int, process: subprocess.Popen[str]) -> dict[str, str]:
    """Failed checks of a group and the reasons; if its child process dies, a new one continues with the next check."""
    failures: dict[str, str] = {}
    group = groups()[index]
    begun = 0
    while True:
        output, errors = process.communicate()
        running = "starting the self-test"
        for line in output.splitlines():
            kind, text = json.loads(line)
            if kind == "begin":
                running = text
                begun += 1
            else:
                failures[running] = text
        if process.returncode == 0:
            return failures
        status = process.returncode
        if status < 0:
            failures[running] = f"it ended the process with signal {signal.Signals(-status).name}"
        else:
            last = (errors.strip().splitlines() or ["no message"])[-1].strip()
            failures[running] = f"it ended the process with status {status} ({last})"
        if running == "starting the self-test" or begun == len(group):
            return failures
        process = start_child(index, begun)


def sentences(missing: dict[str, set[str]], failures: dict[str, str], listed: dict[str, str]) -> list[str]:
    """The report: one sentence per missing library, and one per failed check that is not explained by these.

    Args:
        missing: library to the packages that need it.
        failures: check to the reason of its failure.
        listed: library to Debian package.
    """
    lines = []
    for library, packages in sorted(missing.items()):
        package = debian_package(library, listed)
        users = ", ".join(sorted(packages))
        lines.append(f"{library}, required by {users}, was not found; install {package} (Debian, Ubuntu).")
    unexplained = set().union(*missing.values()) if missing else set()
    uses = {check.does: check.uses for group in groups() for check in group}
    for does, why in failures.items():
        if not unexplained.intersection(uses.get(does, ())):
            lines.append(f"{does[0].upper()}{does[1:]} failed: {why.rstrip('.')}.")
    return lines


def main() -> int:
    """Run all checks and print the report; returns the exit status."""
    begun = time.monotonic()
    children = [start_child(index) for index in range(len(groups()))]
    listed = listed_libraries(SYSTEM_PACKAGES.read_text(encoding="utf-8"))
    outside = outside_libraries(Path(sysconfig.get_path("platlib")))
    missing = {library: outside[library] for library in not_found(outside)}
    failures: dict[str, str] = {}
    for index, process in enumerate(children):
        failures |= collect(index, process)
    lines = sentences(missing, failures, listed)
    for line in lines:
        print(line, file=sys.stderr)
    if not lines:
        number = sum(len(group) for group in groups())
        print(f"Self-test: {number} checks passed in {time.monotonic() - begun:.0f} s")
    return 1 if lines else 0


if __name__ == "__main__":
    if len(sys.argv) > 1:
        child(int(sys.argv[1]), int(sys.argv[2]))
    else:
        sys.exit(main())
