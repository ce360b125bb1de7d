"""Old names of settings: accepted in files and on the command line, reported once, and never making a result stale."""

from __future__ import annotations

from pathlib import Path

import pytest

from pipelines.config import Config, dump_config, load_config
from pipelines.config import renamed as table
from pipelines.config.loading import all_names, digest_text
from pipelines.config.renamed import first_tree
from pipelines.stages.params import settings_of
from tests.support.errors import refuses

EXAMPLES = {
    "calibrate.lens": ("OPENCV", "OPENCV"),
    "calibrate.shared_lens": (True, True),
    "calibrate.lens_groups": ([["a", "b"]], (("a", "b"),)),
    "calibrate.lens_images": ("lenses/{camera}.mp4", "lenses/{camera}.mp4"),
    "calibrate.known": ("old.json", "old.json"),
    "calibrate.keep_known": (False, False),
    "calibrate.keep_poses": (True, True),
    "calibrate.board_stands": (True, True),
    "train.density": ("gradient", "default"),
    "train.motion_velocity_neighbours": (7, 7),
    "train.motion_neighbours": (5, 5),
    "train.simulate_quantisation": (True, True),
    "initialise.points": (777, 777),
}


def value_of(config: Config, name: str) -> object:
    section, setting = name.split(".")
    return getattr(getattr(config, section), setting)


def test_every_entry_is_tested_and_leads_to_a_setting() -> None:
    assert set(table.SETTINGS) | {"initialise.points"} == set(EXAMPLES)
    assert set(table.SETTINGS.values()) <= set(all_names())
    assert not set(table.SETTINGS) & set(all_names())


@pytest.mark.parametrize("old", EXAMPLES)
def test_old_names_in_files_and_on_the_command_line(
    old: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    given, wanted = EXAMPLES[old]
    new = table.current_name(old)
    section, setting = old.split(".")
    path = tmp_path / "old.yaml"
    path.write_text(f"{section}: {{{setting}: {given!r}}}\n".replace("True", "true").replace("False", "false"))
    monkeypatch.setattr(table, "_noted", set())
    assert value_of(load_config(path), new) == wanted
    told = capsys.readouterr().err
    assert told.count("\n") == 1
    assert str(path) in told
    assert (new if section != "initialise" else "initialize") in told
    load_config(path)
    assert capsys.readouterr().err == "", "told once"
    assert value_of(load_config(None, [(old, given)]), new) == wanted
    assert new in capsys.readouterr().err


def test_digests_are_those_of_the_first_names(tmp_path: Path) -> None:
    config = load_config(None, [(old, given) for old, (given, _) in EXAMPLES.items()])
    (tmp_path / "first.yaml").write_text(digest_text(config))
    text = digest_text(config)
    for old in EXAMPLES:
        assert f"  {old.split('.')[1]}: " in text or f"  {old.split('.')[1]}:\n" in text
    assert "density: gradient" in text
    again = load_config(tmp_path / "first.yaml")
    assert again.model_dump(exclude={"capture"}) == config.model_dump(exclude={"capture"})
    assert digest_text(Config()) != dump_config(Config())


def test_a_setting_added_later_makes_nothing_stale() -> None:
    before = load_config(None, [("train.full_size_details", False)])  # the default is another now
    for name, value in table.ADDED.items():
        section = name.partition(".")[0]
        found = value_of(before, name)
        found = list(found) if isinstance(found, tuple) else found  # as in JSON
        assert found == value, "it keeps the old behavior"
        assert name not in settings_of(before, section)
        assert name.partition(".")[2] not in first_tree(before.model_dump(mode="json"))[section]
    changed = load_config(None, [("train.regularize", "motion")])
    assert settings_of(changed, "train")["train.regularize"] == "motion"
    assert "regularize: motion" in digest_text(changed)
    assert "regularize" not in digest_text(Config())


def test_an_older_take_keeps_what_it_trained(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its settings lack those that came later; a new take's settings and a user's file have the defaults."""
    monkeypatch.setitem(table.ADDED, "train.dropout", 0.0)  # as if it had come later
    (tmp_path / "config.yaml").write_text("train: {group_size: 12}\n")
    assert load_config(tmp_path / "config.yaml").train.dropout == 0.2
    (tmp_path / "take.json").write_text("{}")
    assert load_config(tmp_path / "config.yaml").train.dropout == 0.0
    assert load_config(tmp_path / "config.yaml", [("train.dropout", 0.1)]).train.dropout == 0.1
    (tmp_path / "config.yaml").write_text(dump_config(Config()))
    assert load_config(tmp_path / "config.yaml").train == Config().train


def test_names_go_there_and_back() -> None:
    for name in all_names():
        assert table.current_name(table.first_name(name)) == name
    assert table.current_names(table.first_names({"train.strategy": "mcmc", "result of initialize": "x"})) == {
        "train.strategy": "mcmc", "result of initialize": "x",
    }  # fmt: skip


def test_both_names_at_once_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "both.yaml"
    path.write_text("calibrate: {lens: OPENCV, camera_model: PINHOLE}\n")
    with refuses("settings.both_names", file=path, setting="calibrate.camera_model"):
        load_config(path)
