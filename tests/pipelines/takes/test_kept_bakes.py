"""Bakes that are kept under names: a bake of another QP does not lose them, and choosing one brings all of it back."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from pipelines.config import load_config
from pipelines.runs.runner import ALL_STAGES
from pipelines.takes.integrity import check_take
from pipelines.takes.kept_bakes import choose_bake, keep_bake, kept_bake, kept_bakes, note_evaluation, remove_bake
from pipelines.takes.take import Take
from studio.stream import StreamReader
from tests.support.errors import refuses


def contents(folder: Path) -> dict[str, bytes]:
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def states(here: Callable, root: Path) -> dict[str, str]:
    stages = json.loads(here("status", root, "--json").stdout)["stages"]
    return {stage: found["state"] for stage, found in stages.items()}


@pytest.fixture
def take(finished: Path, tmp_path: Path) -> Take:
    return Take.open(Path(shutil.copytree(finished / "take", tmp_path / "take")))


def test_two_bakes_are_kept_and_either_is_chosen(finished: Path, take: Take, here: Callable) -> None:
    first = contents(take.stream)
    assert here("bakes", "keep", take.root, "fine").returncode == 0
    links = [os.stat(path).st_nlink for path in (take.bakes / "fine" / "stream").rglob("*") if path.is_file()]
    assert set(links) == {2}, "hard links take no space"
    assert kept_bake(take, "fine").frees < 100_000, "records and notes only"
    baked = here("bake", take.root, "--bake.qp", "40", "--keep", "coarse")
    assert baked.returncode == 0, baked.stderr
    second = contents(take.stream)
    assert second != first
    assert contents(kept_bake(take, "fine").stream) == first, "baking again leaves what is kept"
    listed = {row["name"]: row for row in json.loads(here("bakes", "list", take.root, "--json").stdout)}
    assert [(name, row["qp"], row["chosen"]) for name, row in listed.items()] == [
        ("fine", 20, False),
        ("coarse", 40, True),
    ]
    with StreamReader.open(Path(listed["coarse"]["stream"])) as reader:
        assert listed["coarse"]["bytes_per_frame"] == round(reader.manifest.bytes_per_frame)
    assert listed["coarse"]["bytes"] == sum(map(len, second.values())) < listed["fine"]["bytes"]
    measured = json.loads((finished / "take" / "evaluation.json").read_text())["summary"]["psnr_decoded"]
    assert (listed["fine"]["psnr_decoded"], listed["coarse"]["psnr_decoded"]) == (measured, None)

    assert here("bakes", "choose", take.root, "fine").returncode == 0
    assert contents(take.stream) == first
    assert load_config(take.config).bake.qp == 20
    assert set(states(here, take.root).values()) == {"done"}, "also the evaluation"
    found = check_take(take, ALL_STAGES)
    assert found.damage == ()
    assert here("bakes", "choose", take.root, "coarse").returncode == 0
    assert (contents(take.stream), load_config(take.config).bake.qp) == (second, 40)
    assert states(here, take.root) == {**dict.fromkeys(ALL_STAGES, "done"), "evaluate": "missing"}
    assert here("evaluate", take.root).returncode == 0
    coarse = kept_bake(take, "coarse").psnr
    assert coarse is not None
    assert coarse < measured, "what is measured later belongs to the kept bake too"
    assert "coarse" in here("bakes", "list", take.root).stdout
    assert here("bakes", "remove", take.root, "fine", "coarse").returncode == 0
    assert (contents(take.stream), take.bakes.exists()) == (second, False)


def test_a_stream_that_is_not_kept_is_not_lost(take: Take, here: Callable) -> None:
    keep_bake(take, "fine")
    (take.stream / "manifest.json").unlink()
    (take.stream / "manifest.json").write_text("{}")
    with refuses("bakes.would_be_lost"):
        choose_bake(take, "fine")
    assert (take.stream / "manifest.json").read_text() == "{}"
    choose_bake(take, "fine", discard=True)
    assert contents(take.stream) == contents(take.bakes / "fine" / "stream")


def test_an_interrupted_choice_is_repeated(take: Take, monkeypatch: pytest.MonkeyPatch) -> None:
    keep_bake(take, "fine")
    before, kept = contents(take.stream), contents(take.bakes)

    def killed(*arguments: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("pipelines.takes.kept_bakes._put_stream", killed)
        with pytest.raises(KeyboardInterrupt):
            choose_bake(take, "fine")
    assert contents(take.bakes) == kept
    assert choose_bake(take, "fine").chosen
    assert contents(take.stream) == before


@pytest.mark.parametrize("name", ["", "..", "a/b", ".hidden", "a\\b", "end.", "x" * 61, "new\nline"])
def test_names_that_are_no_folders_are_refused(take: Take, name: str) -> None:
    for action in (keep_bake, choose_bake, remove_bake):
        with refuses("bakes.invalid_name"):
            action(take, name)
    assert not take.bakes.exists()


def test_refusals_change_nothing(take: Take, here: Callable) -> None:
    with refuses("bakes.not_found"):
        choose_bake(take, "fine")
    keep_bake(take, "fine")
    before = contents(take.root)
    with refuses("bakes.name_taken"):
        keep_bake(take, "fine")
    refused = here("bake", take.root, "--bake.qp", "40", "--keep", "fine")
    assert (refused.returncode, "already kept as 'fine'" in refused.stderr) == (1, True)
    assert here("bakes", "remove", take.root, "fine", "gone").returncode == 1
    take.forget("bake")
    with refuses("bakes.not_baked"):
        keep_bake(take, "other")
    after = contents(take.root)
    assert {name for name in before if before[name] != after.get(name)} <= {
        ".v3studio/lock",
        ".v3studio/stages/bake.json",
    }


def test_check_names_damage_of_a_kept_bake(take: Take, here: Callable) -> None:
    keep_bake(take, "fine")
    assert note_evaluation(take) == [], "it has it already"
    path = next((take.bakes / "fine" / "stream" / "files").iterdir())
    data = bytearray(path.read_bytes())
    data[-5] ^= 1
    path.unlink()  # the take's stream shares the file
    path.write_bytes(data)
    done = here("check", take.root)
    assert done.returncode == 1
    assert f"changed: {path.relative_to(take.root)}" in done.stdout
    assert f"v3studio bakes remove {take.root} fine" in done.stdout
    assert here("check", take.root, "--remove").returncode == 1
    assert path.is_file()
    assert set(states(here, take.root).values()) == {"done"}, "no run makes it again, so no stage is forgotten"
    with refuses("take.damaged"):
        choose_bake(take, "fine")

    note = next((take.bakes / "fine" / "notes").iterdir())
    note.unlink()
    (take.bakes / ".fine.partial").mkdir()
    found = check_take(take, ALL_STAGES).damage
    assert [(damage.file, damage.problem) for damage in found] == [
        (path.relative_to(take.root).as_posix(), "changed"),
        (note.relative_to(take.root).as_posix(), "missing"),
    ]
    (take.bakes / "fine" / "bake.json").write_text("{")
    assert kept_bakes(take) == []
    done = here("check", take.root)
    assert done.returncode == 1
    assert "damaged: bakes/fine/bake.json (cannot be read" in done.stdout
    assert f"v3studio bakes remove {take.root} fine" in done.stdout
    assert remove_bake(take, "fine") > len(data), "a damaged one can be removed"
