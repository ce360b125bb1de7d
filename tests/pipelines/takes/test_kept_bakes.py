"""Bakes that are kept under names: a bake of another QP does not lose them, and choosing one brings all of it back."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from pipelines.cli import execute
from pipelines.config import load_config
from pipelines.stages import STAGE_NAMES
from pipelines.takes.chosen_bake import choose_bake, remarks
from pipelines.takes.edits import change_edits
from pipelines.takes.integrity import check_take
from pipelines.takes.kept_bakes import keep_bake, kept_bake, kept_bakes, note_evaluation, remove_bake
from pipelines.takes.take import Take
from studio.edits.edit_list import EditList, Trim
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
    found = check_take(take, STAGE_NAMES)
    assert found.damage == ()
    assert here("bakes", "choose", take.root, "coarse").returncode == 0
    assert (contents(take.stream), load_config(take.config).bake.qp) == (second, 40)
    assert states(here, take.root) == {**dict.fromkeys(STAGE_NAMES, "done"), "evaluate": "missing"}
    assert here("evaluate", take.root).returncode == 0
    coarse = kept_bake(take, "coarse").psnr
    assert coarse is not None
    assert coarse < measured, "what is measured later belongs to the kept bake too"
    assert "coarse" in here("bakes", "list", take.root).stdout
    assert here("bakes", "remove", take.root, "fine", "coarse").returncode == 0
    assert (contents(take.stream), take.bakes.exists()) == (second, False)


@pytest.mark.parametrize("name", ["", "..", "a/b", ".hidden", "a\\b", "end.", "x" * 61, "new\nline"])
def test_names_that_are_no_folders_are_refused(take: Take, name: str) -> None:
    for action in (keep_bake, choose_bake, remove_bake):
        with refuses("bakes.invalid_name"):
            action(take, name)
    assert not take.bakes.exists()


@pytest.mark.parametrize("name", ["CON", "com1.old", "a.partial", "aux .b"])
def test_names_of_devices_and_temporary_files_are_not_kept(take: Take, name: str) -> None:
    with refuses("bakes.invalid_name"):
        keep_bake(take, name)
    assert not take.bakes.exists()


def test_a_name_is_the_same_in_each_form_of_its_letters(take: Take) -> None:
    """macOS types "é" as two characters."""
    assert keep_bake(take, "cafe\u0301").name == "caf\u00e9"
    assert kept_bake(take, "cafe\u0301").folder == take.bakes / "caf\u00e9"
    with refuses("bakes.name_taken"):
        keep_bake(take, "caf\u00e9")
    remove_bake(take, "cafe\u0301")


def test_a_stream_that_is_not_the_recorded_one_is_not_kept(take: Take) -> None:
    """As after an interrupted `train --live`, which replaces the manifest, and the record stays."""
    manifest = take.stream / "manifest.json"
    text = manifest.read_text()
    manifest.write_text(text.replace("1", "2", 1))
    with refuses("take.damaged", file=manifest):
        keep_bake(take, "fine")
    manifest.unlink()
    manifest.write_text(text)
    next((take.stream / "files").iterdir()).unlink()
    with refuses("take.damaged"):
        keep_bake(take, "fine")
    assert list(take.bakes.iterdir()) == []


def test_a_kept_bake_is_on_the_disk_before_its_note(take: Take, monkeypatch: pytest.MonkeyPatch) -> None:
    synced: list[int] = []
    monkeypatch.setattr(os, "fsync", lambda descriptor: synced.append(os.fstat(descriptor).st_ino))
    kept = keep_bake(take, "fine")
    order = {path: synced.index(path.stat().st_ino) for path in [kept.folder, *kept.folder.rglob("*")]}
    assert (
        max(order[path] for path in order if path.name != "bake.json" and path != kept.folder)
        < order[kept.folder / "bake.json"]
    )


def test_a_bake_of_other_edits_is_told(take: Take, capsys: pytest.CaptureFixture[str]) -> None:
    keep_bake(take, "whole")
    assert kept_bake(take, "whole").same_edits
    change_edits(take.edits, EditList(trim=Trim(first=1, last=3)), "trim")
    assert not kept_bake(take, "whole").same_edits
    assert execute(["bakes", "list", str(take.root)]) == 0
    assert "other edits" in capsys.readouterr().out
    assert "other edits" in remarks(choose_bake(take, "whole"))[0]
    take.edits.write_text("{")
    assert [kept.same_edits for kept in kept_bakes(take)] == [False]


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
    found = check_take(take, STAGE_NAMES).damage
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
