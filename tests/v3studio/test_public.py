"""The public interface that scripts may rely on."""

import doctest
import inspect
import operator
import runpy
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import torch

import v3studio
from tests.support.errors import refuses
from tests.support.warm_python import warm_python
from tests.support.web_servers import PLAYER
from v3studio.pipelines.config.config import values_of
from v3studio.pipelines.share import serving, sharing

pytestmark = pytest.mark.long

ROOT = Path(__file__).parents[2]
EXAMPLES = sorted((ROOT / "examples").glob("[0-9]*.py"))


def test_every_export_is_there_and_documented() -> None:
    for name in v3studio.__all__:
        value = getattr(v3studio, name)
        assert value is not None, name
        if callable(value):
            assert (value.__doc__ or "").strip(), f"{name} has no docstring"


def test_every_path_argument_takes_text() -> None:
    for name in v3studio.__all__:
        value = getattr(v3studio, name)
        methods = inspect.getmembers(value, inspect.isroutine) if isinstance(value, type) else [("", value)]
        for method, function in methods:
            if inspect.isfunction(inspect.unwrap(function)) and not method.startswith("_"):
                for parameter in inspect.signature(function).parameters.values():
                    kinds = str(parameter.annotation).replace("'", "").split(" | ")
                    assert "Path" not in kinds or "str" in kinds, f"{name}.{method}: {parameter.name}"


def test_importing_it_is_light_and_leaves_the_environment_alone() -> None:
    code = (
        "import os, sys\nbefore = dict(os.environ)\nimport v3studio\nassert dict(os.environ) == before\n"
        "heavy = {'torch', 'numpy', 'open3d', 'cv2', 'av', 'pycolmap', 'pymeshlab', 'pydantic'}\n"
        "print(sorted(heavy & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert (done.stdout, done.returncode) == ("[]\n", 0), done.stderr


FIRST = (
    "run", "load_config", "trained_video", "read_evaluation", "open_footage", "read_rig", "rasterize", "evaluate",
    "open_import", "bake_video", "StreamReader.open", "share", "serve",
)  # fmt: skip
"""Functions that scripts call first."""


@pytest.fixture
def workplace(finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working directory with the take and the footage that examples name."""
    shutil.copytree(finished / "take", tmp_path / "my-take")
    shutil.copytree(finished / "capture", tmp_path / "footage")
    monkeypatch.chdir(tmp_path)
    config = (finished / "ball.yaml").read_text().replace("root: capture", f"root: {tmp_path / 'footage'}")
    (tmp_path / "my-take" / "config.yaml").write_text(config)
    monkeypatch.setattr(sharing, "read_player", lambda: PLAYER)
    monkeypatch.setattr(serving, "read_player", lambda: PLAYER)
    return tmp_path


@pytest.mark.parametrize("name", FIRST)
def test_examples_in_docstrings_are_right(name: str, workplace: Path) -> None:
    documented = operator.attrgetter(name)(v3studio)
    parser, runner = doctest.DocTestParser(), doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE)
    names = {"v3": v3studio, "torch": torch}
    test = parser.get_doctest(inspect.getdoc(documented) or "", names, name, None, None)
    said: list[str] = []
    runner.run(test, out=said.append)
    assert runner.summarize(verbose=False) == (0, len(test.examples)), "".join(said)
    assert test.examples


def test_the_quick_start_is_right(workplace: Path) -> None:
    code: str = runpy.run_path(str(ROOT / "docs" / "generate" / "api.py"))["QUICK_START"]
    assert len(code.splitlines()) <= 10
    few = values_of(v3studio.load_config("my-take/config.yaml"))
    short = {name: few[name] for name in few if name.split(".")[0] in ("initialize", "train", "run")}
    smaller = code.replace('"footage", ', '"footage", **short, ').replace('"my-take"', '"new-take"')
    exec(smaller, {"short": short})
    assert (workplace / "site" / "index.html").is_file()


def test_settings_of_a_run_may_be_plain(workplace: Path) -> None:
    take = v3studio.Take.create("new-take")
    events: list[v3studio.Event] = []
    figures = v3studio.run(take, {"capture.root": "footage", "capture.fps": 12}, events.append, stages=["calibrate"])
    assert list(figures) == ["calibrate"]
    assert isinstance(events[-1], v3studio.Finished)
    assert events[-1].result["stages"] == figures
    assert v3studio.load_config(take.config).capture.fps == 12
    with refuses("settings.unknown"):
        v3studio.run(take, {"capture.fpss": 12})


@pytest.mark.parametrize("script", EXAMPLES, ids=lambda path: path.stem)
def test_examples_run(script: Path, tmp_path: Path) -> None:
    """Each example checks its result with an assert."""
    done = warm_python().run((script,), cwd=tmp_path, text=True, timeout=280)
    assert done.returncode == 0, done.stderr[-2000:]
    assert done.stdout


def test_examples_use_the_public_face_only() -> None:
    assert len(EXAMPLES) == 9
    for script in EXAMPLES:
        lines = script.read_text(encoding="utf-8").splitlines()
        assert not [line for line in lines if line.startswith(("import v3studio.", "from v3studio."))]
        assert script.name in (ROOT / "examples" / "README.md").read_text(encoding="utf-8")


def test_paths_may_be_text(tmp_path: Path) -> None:
    take = v3studio.Take.create(str(tmp_path / "take"))
    assert v3studio.Take.open(str(tmp_path / "take")) == take
    (tmp_path / "a.yaml").write_text("bake: {quality: 31}")
    assert v3studio.load_config(str(tmp_path / "a.yaml")).bake.quality == 31
    rig = v3studio.orbit((0, 0, 0), 2.0, 3, width=8, height=6)
    v3studio.write_rig(rig, str(tmp_path / "rig.json"))
    assert v3studio.read_rig(str(tmp_path / "rig.json")).names == rig.names
