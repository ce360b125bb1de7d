"""The public interface that scripts may rely on."""

import inspect
import subprocess
import sys
from pathlib import Path

import pytest

import v3studio
from tests.support.warm_python import warm_python

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
                for found in inspect.signature(function).parameters.values():
                    kinds = str(found.annotation).replace("'", "").split(" | ")
                    assert "Path" not in kinds or "str" in kinds, f"{name}.{method}: {found.name}"


def test_importing_it_is_light_and_leaves_the_environment_alone() -> None:
    code = (
        "import os, sys\nbefore = dict(os.environ)\nimport v3studio\nassert dict(os.environ) == before\n"
        "heavy = {'torch', 'numpy', 'open3d', 'cv2', 'av', 'pycolmap', 'pymeshlab', 'pydantic'}\n"
        "print(sorted(heavy & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert (done.stdout, done.returncode) == ("[]\n", 0), done.stderr


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
