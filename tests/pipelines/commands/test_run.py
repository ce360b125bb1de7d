from collections.abc import Callable
from pathlib import Path

import pytest

from v3studio.pipelines.config import load_config, presets
from v3studio.pipelines.config.presets import preset_of
from v3studio.studio.yaml_text import parse_yaml


@pytest.mark.parametrize("gpu", [False, True])
def test_footage_is_enough(gpu: bool, here: Callable, project: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(presets, "has_gpu", lambda: gpu)
    take, footage = project / "take", project / "capture"
    here("calibrate", footage, "--take", take, "--capture.held_out", "cam4").ok()
    config = load_config(take / "config.yaml")
    assert config.capture.root == footage
    assert preset_of(config) == ("final" if gpu else "standard")
    here("calibrate", footage, "--take", take, "--json").ok()
    assert load_config(take / "config.yaml").capture.held_out == ("cam4",), "the take's settings stay"
    here("calibrate", take, "--preset", "preview").ok()
    assert preset_of(load_config(take / "config.yaml")) == "preview"


def test_a_preset_comes_between_the_file_and_the_command_line(here: Callable, project: Path) -> None:
    options = ("--preset", "preview", "--train.max_splats", "7")
    here("calibrate", project / "ball.yaml", "--take", project / "t", *options).ok()
    config = load_config(project / "t" / "config.yaml")
    assert (config.train.keyframe_iterations, config.train.max_splats) == (800, 7)
    assert config.train.group_size == 3, "from the file: no preset sets it"


def test_without_footage_there_is_no_take(here: Callable, project: Path) -> None:
    (project / "empty").mkdir()
    (project / "loop").symlink_to("loop")
    for arguments in (
        (project / "ball.yaml", "--take", project / "take", "--capture.held_out", "cam9"),
        (project / "ball.yaml", "--take", project / "loop"),
        (project / "empty", "--take", project / "take"),
        ("--take", project / "take", "--capture.root", project / "none"),
        ("--take", project / "take"),
        (project / "capture",),
    ):
        done = here("run", *arguments)
        assert done.returncode in (1, 2)
        assert done.stderr.count("\n") == 1
        assert not (project / "take").exists()


def test_init_writes_settings_that_run(here: Callable, project: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(project)
    here("init", "capture", "--preset", "preview").ok()
    text = Path("capture.yaml").read_text()
    assert set(parse_yaml(text)["capture"]) >= {"root", "images", "rig", "masks", "held_out"}
    assert "6 cameras" in text
    assert "# Camera file: cameras.json." in text.splitlines()
    config = load_config(Path("capture.yaml"))
    assert config.capture.root == project / "capture"
    assert preset_of(config) == "preview"
    assert here("init", "capture").returncode == 1, "it is not replaced"
    assert Path("capture.yaml").read_text() == text
    here("init", "capture", "--overwrite", "--bake.quality", "31").ok()
    assert load_config(Path("capture.yaml")).bake.quality == 31
    Path("notes.txt").write_text("buy milk")
    assert here("init", "capture", "--overwrite", "--out", "notes.txt").returncode == 1, "not a file of settings"
    assert Path("notes.txt").read_text() == "buy milk"
    here("calibrate", "capture.yaml", "--take", "take").ok()
    assert here("init", "take").returncode == 2, "a take has settings already"


def test_sections_and_changed_settings(here: Callable, project: Path) -> None:
    assert set(parse_yaml(here("config", "bake", "run").stdout)) == {"bake", "run"}
    changed = parse_yaml(here("config", project / "ball.yaml", "train", "--changed").stdout)
    assert set(changed) == {"train"}
    assert changed["train"]["keyframe_iterations"] == 25
    assert "sh_degree_every" not in changed["train"]
    assert parse_yaml(here("config", "--changed").stdout) is None
    assert here("config", project / "ball.yaml", project / "other.yaml").returncode == 2
