"""The structure holds: imports run downwards, help is quick, dependencies say why, no machine's paths."""

import ast
import functools
import graphlib
import importlib.metadata
import re
import subprocess
import sys
import tomllib
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[1]
PACKAGES = ("v3studio", "gui", "pipelines", "studio")  # each may import the ones after it
INSTALLED = ("v3studio", "v3studio.gui", "v3studio.pipelines", "v3studio.studio")  # their names as packages
PYPROJECT = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
PROJECT = tomllib.loads(PYPROJECT)["project"]
EXTRAS = PROJECT["optional-dependencies"]
HEAVY = ("torch", "open3d", "pycolmap", "pymeshlab", "cv2", "av", "matplotlib", "onnxruntime")


@functools.cache
def nodes(path: Path) -> tuple[ast.Import | ast.ImportFrom | ast.Call, ...]:
    """Imports of a file, inside functions too, and the calls that tests here look at: each file is parsed once."""
    return tuple(
        node
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"), filename=str(path)))
        if isinstance(node, ast.Import | ast.ImportFrom)
        or (isinstance(node, ast.Call) and called(node) in ("import_module", "__import__", "StudioError"))
    )


def called(node: ast.Call) -> str:
    """The last part of the name of what is called; "" if it has no name."""
    return node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")


def imported_names(path: Path) -> Iterator[tuple[int, str]]:
    """(line, dotted module) of every import in a file; relative ones made absolute."""
    package = path.relative_to(ROOT).parent.parts
    for node in nodes(path):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield node.lineno, alias.name
        elif isinstance(node, ast.ImportFrom):
            base = ".".join(package[: len(package) - node.level + 1]) if node.level else ""
            yield node.lineno, ".".join(part for part in (base, node.module or "") if part)
        elif called(node) != "StudioError" and node.args and isinstance(node.args[0], ast.Constant):
            yield node.lineno, str(node.args[0].value)


def tracked_files() -> list[Path]:
    """Files that git tracks, or would track: nothing that is ignored."""
    command = ["git", "ls-files", "--cached", "--others", "--exclude-standard", "-z"]
    listing = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    return [path for name in listing.stdout.split("\0") if name and (path := ROOT / name).is_file()]


def test_no_folder_has_more_files_than_a_reader_can_survey() -> None:
    files = [path for path in tracked_files() if path.suffix in (".py", ".ts", ".cpp", ".h")]
    assert files
    assert {str(one): count for one, count in Counter(path.parent for path in files).items() if count > 25} == {}


def test_every_imported_package_is_declared() -> None:
    """A package that is here by chance, as a dependency of another one, is missing on some other machine."""
    extras = [text for name, texts in EXTRAS.items() if name != "docs" for text in texts]
    declared = {canonicalize_name(Requirement(text).name) for text in (*PROJECT["dependencies"], *extras)}
    installed = importlib.metadata.packages_distributions() | {"open3d": ["open3d"]}  # scripts/setup.sh: open3d-cpu
    # benchmarks/studio has an environment of its own.
    apart = (ROOT / "docs", ROOT / "benchmarks" / "studio")
    files = [path for path in tracked_files() if path.suffix == ".py" and not set(apart) & set(path.parents)]
    own = {path.stem for path in files} | {part for path in files for part in path.relative_to(ROOT).parts[:-1]}
    wrong = {
        f"{path.relative_to(ROOT)}:{line} imports {module}"
        for path in files
        for line, name in imported_names(path)
        if (module := name.split(".")[0]) not in own and module not in sys.stdlib_module_names
        if declared.isdisjoint(canonicalize_name(each) for each in installed.get(module, [module]))
    }
    assert not wrong


PIPELINES = (
    "cli", "commands", "comparison", "estimate", "export", "share", "review", "batch", "runs", "new_take",
    "inspection", "stages", "reports", "outputs", "takes", "events", "config", "version",
)  # fmt: skip
"""Modules of `pipelines`, top down: each may import the ones after it, and nothing before or beside it."""


def assert_no_circle(edges: dict[str, set[str]]) -> None:
    """No modules import each other in a circle."""
    try:
        graphlib.TopologicalSorter(edges).prepare()
    except graphlib.CycleError as error:
        pytest.fail(" <- ".join(error.args[1]))


@functools.cache
def module_edges() -> dict[str, set[str]]:
    """Module to the modules that it imports, inside functions and for types too. A name of a package counts as the
    submodule of that name where there is one, else as the package itself."""
    modules = {}
    for package, name in zip(PACKAGES, INSTALLED, strict=True):
        for path in (ROOT / package).rglob("*.py"):
            inner = path.relative_to(ROOT / package).with_suffix("").parts
            modules[".".join((name, *inner)).removesuffix(".__init__")] = path
    edges: dict[str, set[str]] = {}
    for module, path in modules.items():
        targets = set()
        for node in nodes(path):
            if isinstance(node, ast.Import):
                targets |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
                for alias in node.names:
                    inner = f"{node.module}.{alias.name}"
                    targets.add(inner if inner in modules else node.module)
            elif isinstance(node, ast.Call) and node.args and isinstance(node.args[0], ast.Constant):
                targets.add(str(node.args[0].value))
        edges[module] = {name for name in targets if name in modules and name != module}
    return edges


def test_no_modules_import_in_a_circle() -> None:
    edges = module_edges()
    assert len(edges) > 200
    assert_no_circle(edges)


WEB = ("stream", "worker", "render", "player", "xr", "ui", "review", "cast")
"""Folders of web/src, bottom up: each may import itself and the ones before it."""


def test_the_players_folders_import_downwards_and_not_in_a_circle() -> None:
    source = ROOT / "web" / "src"
    edges: dict[str, set[str]] = {}
    for folder in WEB:
        for path in sorted((source / folder).glob("*.ts")):
            found = re.findall(r'(?:from|import) "(\.[^"]+\.ts)"', path.read_text(encoding="utf-8"))
            targets = {(path.parent / name).resolve().relative_to(source).as_posix() for name in found}
            edges[path.relative_to(source).as_posix()] = targets
            above = {one for one in targets if WEB.index(one.split("/")[0]) > WEB.index(folder)}
            assert not above, f"{path.relative_to(ROOT)} imports {above}"
    assert len(edges) > 50
    assert_no_circle(edges)


GUI = (
    "app", "window", "user_input", "overlays", "state", "actions", "pace", "figures", "layout", "viewport",
    "pages", "widgets", "models.take", "models.playback", "models.scene", "models", "drawing", "platform",
)  # fmt: skip
"""Modules of `gui`, top down: each may import the ones after it, and nothing before it."""


STUDIO = (
    "playback", "comparison", "perceptual", "formats", "edits", "scenery", "training", "card", "meshing", "stream",
    "rasterizer", "splat_video", "calibration", "camera_files", "footage", "masks", "audio", "capture", "storage",
    "gaussians", "own_frame", "similarity", "cameras", "lenses", "rotations", "torch_rotations", "metrics",
    "color_fit", "chroma", "dilation", "settings", "yaml_text", "bounded_files", "atomic_files", "memory",
    "memory_cache", "process", "progress", "validation", "counts", "errors", "json_types",
)  # fmt: skip
"""Modules of `studio`, top down: each may import the ones after it, and nothing before it."""


@pytest.mark.parametrize(
    ("root", "order"),
    [("", INSTALLED), ("v3studio.pipelines.", PIPELINES), ("v3studio.gui.", GUI), ("v3studio.studio.", STUDIO)],
)
def test_packages_import_downwards(root: str, order: tuple[str, ...]) -> None:
    def level(module: str) -> int:
        """The place of the longest name in `order` that the module is in."""
        inner = f"{module.removeprefix(root)}."
        return order.index(max((name for name in order if inner.startswith(f"{name}.")), key=len))

    wrong, seen = [], set()
    for module, targets in module_edges().items():
        if not module.startswith(root):
            continue
        seen.add(order[level(module)])
        for target in targets:
            if f"{target}." == root or (target.startswith(root) and level(target) < level(module)):
                wrong.append(f"{module} imports {target}")
    assert seen == set(order)
    assert not wrong, "\n".join(wrong)


def test_the_table_of_studios_packages_has_their_order() -> None:
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    table = page.partition("### studio: the library")[2].partition("\n### ")[0]
    first_cells = re.findall(r"^\| (`.+?) \|", table, re.M)
    assert tuple(name for cell in first_cells for name in re.findall(r"`(\w+)(?:/|\.py)`", cell)) == STUDIO


@pytest.mark.parametrize(
    ("folders", "forbidden", "exception"),
    [
        (PACKAGES, "tests", ""),
        (("gui",), "v3studio.pipelines.stages", "gui/models/stages.py"),
        (("gui/models", "gui/drawing"), "open3d", ""),
        (("gui/pages",), "open3d", "gui/pages/start/panel.py"),  # the start page's panel is a widget
    ],
)
def test_what_is_imported_in_one_place_only(folders: tuple[str, ...], forbidden: str, exception: str) -> None:
    files = [path for folder in folders for path in sorted((ROOT / folder).rglob("*.py"))]
    assert files
    wrong = [
        f"{path.relative_to(ROOT)}:{line} imports {name}"
        for path in files
        for line, name in imported_names(path)
        if f"{name}.".startswith(f"{forbidden}.") and path.relative_to(ROOT).as_posix() != exception
    ]
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize("module", ["v3studio.pipelines.cli", "v3studio.gui.app"])
def test_help_imports_nothing_heavy(module: str) -> None:
    code = (
        f"import sys, {module} as command\nsys.argv = ['command', '--help']\n"
        "try:\n    command.main()\nexcept SystemExit as stop:\n    assert not stop.code\n"
        f"print('LOADED', sorted(set({HEAVY!r}) & set(sys.modules)))"
    )
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=280, check=False)
    assert done.returncode == 0, done.stderr
    assert "usage:" in done.stdout
    assert "LOADED []" in done.stdout


def test_each_dependency_says_why() -> None:
    named = [*PROJECT["dependencies"], *(name for extra in EXTRAS.values() for name in extra)]
    assert len(named) > 10
    for requirement in named:
        lines = [line for line in PYPROJECT.splitlines() if f'"{requirement}"' in line and line[:8] != "requires"]
        assert lines, requirement
        assert all(re.search(r",\s+# \S.{5,}", line) for line in lines), f"{requirement}: no reason given"


# Where the import's name is not the package's. torch, numpy and so on are the same.
MODULES = {
    "lazy-loader": "lazy_loader", "opencv-contrib-python-headless": "cv2", "pillow": "PIL", "ruamel.yaml": "ruamel",
    "usd-core": "pxr", "openimageio": "OpenImageIO",
}  # fmt: skip
NEVER_IMPORTED = {"s3fs", "gcsfs", "adlfs"}  # fsspec imports them
FROM_TORCH = {"triton"}  # torch's CUDA builds for Linux bring the version that fits them


def test_what_is_imported_is_declared_and_what_is_declared_is_imported() -> None:
    shipped = ("matting", "usd", "film", "s3", "gs", "azure", "cluster")
    wanted = [*PROJECT["dependencies"], *(text for name in shipped for text in EXTRAS[name])]
    names = {Requirement(text).name for text in wanted} - NEVER_IMPORTED
    declared = {MODULES.get(name, name) for name in names}
    imported = {
        name.split(".")[0]
        for package in PACKAGES
        for path in (ROOT / package).rglob("*.py")
        for _, name in imported_names(path)
    }
    foreign = {name for name in imported if name not in sys.stdlib_module_names and name not in PACKAGES}
    assert foreign - declared - FROM_TORCH == set(), "imported, but not among pyproject's dependencies"
    assert declared - foreign == set(), "among pyproject's dependencies, but never imported"


def test_the_lock_pins_every_dependency_within_its_range() -> None:
    pinned = {}
    for lock in ("requirements.lock", "requirements-dev.lock", "requirements-docs.lock"):
        for line in (ROOT / lock).read_text(encoding="utf-8").splitlines():
            if line and not line.startswith(("#", " ")):  # their hashes are indented
                name, _, version = line.removesuffix(" \\").partition("==")
                assert version, f"{lock}: {line} is not pinned"
                # what tests and the documentation need is listed in both
                assert pinned.get(canonicalize_name(name), version) == version, f"{lock}: {name} has two versions"
                pinned[canonicalize_name(name)] = version
    for text in [*PROJECT["dependencies"], *EXTRAS["build"], *EXTRAS["dev"], *EXTRAS["docs"]]:
        requirement = Requirement(text)
        version = pinned.get(canonicalize_name(requirement.name))
        assert version is not None, f"{requirement.name} is in no lock"
        assert requirement.specifier.contains(version), f"{text}: the lock has {version}"


def test_no_file_names_a_machines_folders() -> None:
    # Written in pieces, so that this file does not find itself.
    pattern = re.compile(rb"/" rb"(?:home|Users)/[a-z]|/" rb"root/|/" rb"work/(?:main|shared)|/" rb"tmp/[A-Za-z]")
    texts = (".py", ".md", ".toml", ".yaml", ".yml", ".json", ".txt", ".cpp", ".h", ".sh", ".cfg", ".lock", ".html", "")
    wrong = [
        f"{path.relative_to(ROOT)}: {found.group().decode()}"
        for path in tracked_files()
        if path.suffix in texts and (found := pattern.search(path.read_bytes()))
    ]
    assert not wrong, "\n".join(wrong)


STARTS = re.compile(r"sys\.executable|(subprocess|os)\.(Popen|run|call|check_\w+|exec\w+|\w*spawn\w*|system|popen)\(")
"""Calls that start a program; types and constants of `subprocess` are harmless."""


def test_programs_are_started_in_one_place() -> None:
    """A Python that is started in another way may execute a file in someone else's take or footage."""
    allowed = {"studio/process.py", "gui/platform/desktop.py"}  # the second opens folders, with no Python
    starting, forbidden = set(), []
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            name = path.relative_to(ROOT).as_posix()
            if STARTS.search(path.read_text(encoding="utf-8")):
                starting.add(name)
            forbidden += [f"{name} imports {module}" for _, module in imported_names(path) if module in NEVER_STARTED]
            forbidden += [
                f"{name} imports from subprocess"
                for node in nodes(path)
                if isinstance(node, ast.ImportFrom) and node.module in ("subprocess", "os")
                if any(STARTS.search(f"{node.module}.{alias.name}(") for alias in node.names)
            ]
    assert starting == allowed
    assert not forbidden, "\n".join(forbidden)


NEVER_STARTED = ("multiprocessing", "concurrent.futures.process", "pty")
"""Modules that start a Python themselves."""


def test_every_error_has_a_code() -> None:
    """`StudioError("area.what", "problem", ...)`, and what makes one: programs and tests act on the code."""
    wrong, found = [], 0
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            for node in nodes(path):
                if not (isinstance(node, ast.Call) and called(node) in ("StudioError", "damaged", "camera_error")):
                    continue
                found += 1
                code = node.args[0] if node.args else None
                if isinstance(code, ast.Constant) and not re.fullmatch(r"[a-z][a-z0-9_]*\.[a-z0-9_]+", str(code.value)):
                    wrong.append(f"{path.relative_to(ROOT)}:{node.lineno}: {code.value!r}")
    assert found > 300
    assert not wrong, "\n".join(wrong)
