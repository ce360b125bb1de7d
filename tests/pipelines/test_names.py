"""Takes, footage, cameras, exports with spaces, symbols and non-ASCII letters in their names, in a minimal locale."""

import json
import os
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import cv2
import pytest

from pipelines.events import Finished, RunStarted, parse_event
from studio.yaml_text import dump_yaml, parse_yaml
from tests.support.events import result_of
from tests.support.warm_python import warm_python

pytestmark = pytest.mark.long

NAMES = {"cam0": "cam 0", "cam1": "caméra 1", "cam2": "影2", "cam4": "Kamera ñ #4"}
TAKE = "prise é 影 #1 50%"


@pytest.fixture(scope="module")
def run_in() -> Callable[..., subprocess.CompletedProcess[bytes]]:
    """The command line with a given locale, or with that of the tests."""
    root = Path(__file__).parents[2]

    def run(locale: str | None, *arguments: object, cwd: Path = root) -> subprocess.CompletedProcess[bytes]:
        environment = {**os.environ, "COLUMNS": "200", **({"LC_ALL": locale, "LANG": locale} if locale else {})}
        return warm_python(locale).run(("-m", "pipelines.cli", *arguments), cwd=cwd, env=environment)

    return run


@pytest.fixture(scope="module")
def place(finished: Path, tmp_path_factory: pytest.TempPathFactory, run_in: Callable) -> Path:
    """A project with a take finished under LC_ALL=C: renamed cameras, masks in separate files."""
    folder = tmp_path_factory.mktemp("lieu") / "studio é 影"
    shutil.copytree(finished / "capture", folder / "footage à & co")
    capture = folder / "footage à & co"
    rig = json.loads((capture / "cameras.json").read_text())
    for camera in rig["cameras"]:
        old = camera["name"]
        camera["name"] = new = NAMES.get(old, old)
        (capture / "images" / old).rename(capture / "images" / new)
        (capture / "mask é" / new).mkdir(parents=True)
        for path in (capture / "images" / new).iterdir():
            image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
            assert cv2.imwrite(str(capture / "mask é" / new / path.name), image[..., 3])
            assert cv2.imwrite(str(path), image[..., :3])
    (capture / "caméras.json").write_text(json.dumps(rig, ensure_ascii=False), encoding="utf-8")
    (capture / "cameras.json").unlink()
    settings = parse_yaml((finished / "ball.yaml").read_text())
    settings["capture"] |= {
        "root": capture.name,
        "rig": "caméras.json",
        "masks": "files",
        "mask_files": "mask é/{camera}/{frame:03d}.png",
        "held_out": [NAMES["cam4"]],
        "frames": ":2",
    }
    settings["run"]["preview_seconds"] = 0.01
    (folder / "réglages 影.yaml").write_text(dump_yaml(settings), encoding="utf-8")
    # relative, from the project's folder, as people type it
    done = run_in("C", "run", "réglages 影.yaml", "--take", TAKE, "--json", cwd=folder)
    assert done.returncode == 0, done.stderr.decode()
    events = [parse_event(line) for line in done.stdout.decode("utf-8").splitlines()]
    assert isinstance(events[0], RunStarted)
    assert events[0].take == str(folder / TAKE)
    assert isinstance(events[-1], Finished)
    assert events[-1].outcome == "done"
    return folder


def test_the_take_is_up_to_date_in_every_locale(place: Path, run_in: Callable) -> None:
    for locale in ("C", None):
        status = result_of(run_in(locale, "status", place / TAKE, "--json").stdout)
        assert status["take"] == str(place / TAKE)
        assert {stage["state"] for stage in status["stages"].values()} == {"done"}
        again = run_in(locale, "run", place / TAKE, "--json")
        assert again.returncode == 0, again.stderr
        assert json.loads(again.stdout.decode().splitlines()[0])["stages"] == []


def test_names_stand_in_the_results_as_they_are(place: Path, run_in: Callable) -> None:
    take = place / TAKE
    assert str(place / "footage à & co") in (take / "config.yaml").read_text(encoding="utf-8")
    rig = json.loads((take / "calibrate" / "rig.json").read_text(encoding="utf-8"))
    assert {camera["name"] for camera in rig["cameras"]} >= set(NAMES.values())
    evaluation = (take / "evaluation.json").read_text(encoding="utf-8")
    assert NAMES["cam4"] in evaluation
    shown = run_in("C", "config", place / "réglages 影.yaml").stdout.decode("utf-8")
    assert "root: " in shown
    assert "footage à & co" in shown
    assert NAMES["cam4"] in shown
    assert parse_yaml(shown)["capture"]["held_out"] == [NAMES["cam4"]]


@pytest.mark.parametrize("kind", ["ply", "turntable"])
def test_exports_and_imports(place: Path, run_in: Callable, tmp_path: Path, kind: str) -> None:
    out = tmp_path / f"sortie é 影 {kind}{'.mp4' if kind == 'turntable' else ''}"
    more = ("--size", "64x64", "--seconds", "0.2") if kind == "turntable" else ()
    done = run_in("C", "export", place / TAKE, "--format", kind, "--out", out, *more)
    assert done.returncode == 0, done.stderr.decode()
    assert out.name in done.stdout.decode("utf-8")
    assert out.is_file() if kind == "turntable" else len(list(out.glob("*.ply"))) == 2
    if kind == "ply":
        stream = tmp_path / "importé 影"
        done = run_in("C", "import", out, "--out", stream, "--json")
        assert done.returncode == 0, done.stderr.decode()
        report = result_of(run_in("C", "play", stream, "--json").stdout)
        assert len(report["frames"]) == 2


def test_a_path_that_is_not_utf8_is_refused_in_a_sentence(place: Path, run_in: Callable, tmp_path: Path) -> None:
    wrong = tmp_path / os.fsdecode(b"pris\xe9")
    done = run_in("C", "run", place / "réglages 影.yaml", "--take", wrong, "--json")
    assert done.returncode == 1
    assert b"the path is not valid UTF-8. Rename the folder." in done.stderr
    assert done.stderr.count(b"\n") == 1
    assert not os.path.exists(wrong)
    wrong.mkdir()
    shutil.copy(place / "réglages 影.yaml", wrong / "settings.yaml")
    done = run_in("C", "run", wrong / "settings.yaml", "--take", tmp_path / "take")
    assert done.returncode == 1
    assert b"not valid UTF-8" in done.stderr
    assert not (tmp_path / "take").exists()
