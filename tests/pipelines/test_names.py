"""Takes, footage, cameras, exports with spaces, symbols and non-ASCII letters in their names, in a minimal locale."""

import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import pytest

from tests.support.tiny_capture import ROOT, Done
from tests.support.warm_python import warm_python
from v3studio.studio.yaml_text import dump_yaml, parse_yaml

pytestmark = pytest.mark.long

NAMES = {"cam0": "cam 0", "cam1": "caméra 1", "cam2": "影2", "cam4": "Kamera ñ #4"}
TAKE = "prise é 影 #1 50%"


def in_c(*arguments: object, cwd: Path = ROOT) -> Done:
    """The command line with LC_ALL=C; its output is UTF-8 all the same."""
    environment = {**os.environ, "COLUMNS": "200", "LC_ALL": "C", "LANG": "C"}
    done = warm_python("C").run(("-m", "v3studio.pipelines.cli", *arguments), cwd=cwd, env=environment)
    return Done(done.returncode, done.stdout.decode(), done.stderr.decode())


@pytest.fixture(scope="module")
def place(finished: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
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
    settings["capture"] |= {"root": capture.name, "rig": "caméras.json", "masks": "files", "frames": ":2"}
    settings["capture"] |= {"mask_files": "mask é/{camera}/{frame:03d}.png", "held_out": [NAMES["cam4"]]}
    settings["run"]["preview_seconds"] = 0.01
    (folder / "réglages 影.yaml").write_text(dump_yaml(settings), encoding="utf-8")
    # relative, from the project's folder, as people type it
    done = in_c("run", "réglages 影.yaml", "--take", TAKE, "--json", cwd=folder).ok()
    assert done.events[0].take == str(folder / TAKE)
    assert done.events[-1].outcome == "done"
    return folder


def test_the_take_is_up_to_date_in_every_locale(place: Path, here: Callable) -> None:
    for run in (in_c, here):
        status = run("status", place / TAKE, "--json").result
        assert status["take"] == str(place / TAKE)
        assert {stage["state"] for stage in status["stages"].values()} == {"done"}
        again = run("run", place / TAKE, "--json").ok()
        assert json.loads(again.stdout.splitlines()[0])["stages"] == []


def test_names_stand_in_the_results_as_they_are(place: Path) -> None:
    take = place / TAKE
    assert str(place / "footage à & co") in (take / "config.yaml").read_text(encoding="utf-8")
    rig = json.loads((take / "calibrate" / "rig.json").read_text(encoding="utf-8"))
    assert {camera["name"] for camera in rig["cameras"]} >= set(NAMES.values())
    evaluation = (take / "evaluation.json").read_text(encoding="utf-8")
    assert NAMES["cam4"] in evaluation
    shown = in_c("config", place / "réglages 影.yaml").stdout
    assert "footage à & co" in shown
    assert NAMES["cam4"] in shown
    assert parse_yaml(shown)["capture"]["held_out"] == [NAMES["cam4"]]


def test_exports_and_imports(place: Path, tmp_path: Path) -> None:
    plys, movie, stream = (tmp_path / name for name in ("sortie é 影", "film é 影.mp4", "importé 影"))
    assert plys.name in in_c("export", place / TAKE, "--format", "ply", "--out", plys).ok().stdout
    options = ("--format", "turntable", "--size", "64x64", "--seconds", "0.2")
    assert movie.name in in_c("export", place / TAKE, *options, "--out", movie).ok().stdout
    assert movie.is_file()
    in_c("import", plys, "--out", stream, "--json").ok()
    assert len(in_c("play", stream, "--json").result["frames"]) == 2


def test_a_path_that_is_not_utf8_is_refused_in_a_sentence(place: Path, tmp_path: Path) -> None:
    wrong = tmp_path / os.fsdecode(b"pris\xe9")
    done = in_c("run", place / "réglages 影.yaml", "--take", wrong, "--json")
    assert done.fails("the path is not valid UTF-8. Rename the folder.").stderr.count("\n") == 1
    assert not os.path.exists(wrong)
    wrong.mkdir()
    shutil.copy(place / "réglages 影.yaml", wrong / "settings.yaml")
    in_c("run", wrong / "settings.yaml", "--take", tmp_path / "take").fails("not valid UTF-8")
    assert not (tmp_path / "take").exists()
