import json
import os
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.support.errors import refuses
from tests.support.sounds import clicks, write_wav
from tests.support.streams import contents
from v3studio.pipelines.config import load_config
from v3studio.pipelines.stages import STAGE_NAMES
from v3studio.pipelines.takes.authored.edits import read_edits
from v3studio.pipelines.takes.files.settings_file import set_settings
from v3studio.pipelines.takes.results.integrity import check_take
from v3studio.pipelines.takes.results.kept_bakes import keep_bake, kept_bakes
from v3studio.pipelines.takes.take import Take
from v3studio.studio.edits.edit_list import CropBox, EditList
from v3studio.studio.stream import StreamReader


def replace_file(path: Path, data: bytes) -> None:
    """Write a file anew, as a hard link of it stays as it was."""
    path.unlink()
    path.write_bytes(data)


def test_two_bakes_are_kept_and_compared(finished: Path, take: Take, here: Callable, tmp_path: Path) -> None:
    first = contents(take.stream)
    here("bake", "keep", take.root, "fine").ok()
    links = [os.stat(path).st_nlink for path in (take.bakes / "fine" / "stream").rglob("*") if path.is_file()]
    assert set(links) == {2}, "hard links take no space"
    here("bake", take.root, "--bake.quality", "40", "--keep", "coarse").ok()
    second = contents(take.stream)
    assert second != first
    assert contents(take.bakes / "fine" / "stream") == first, "baking again leaves what is kept"
    listed = {row["name"]: row for row in here("bake", "list", take.root, "--json").result["bakes"]}
    bakes = {name: (row["settings"]["bake.quality"], row["is_stream"]) for name, row in listed.items()}
    assert bakes == {"fine": (22, False), "coarse": (40, True)}
    with StreamReader.open(Path(listed["coarse"]["folder"]) / "stream") as reader:
        assert listed["coarse"]["bytes_per_frame"] == round(reader.played_bytes / reader.frame_count)
    assert listed["coarse"]["bytes"] == sum(map(len, second.values())) < listed["fine"]["bytes"]
    measured = json.loads((finished / "take" / "evaluation.json").read_text())["summary"]["psnr_decoded"]
    assert (listed["fine"]["psnr_decoded"], listed["coarse"]["psnr_decoded"]) == (measured, None)
    kept = [take.bakes / name for name in ("fine", "coarse")]
    assert [load_config(folder / "config.yaml").bake.quality for folder in kept] == [22, 40]
    compared = here("compare", *kept, "--frames", "::5", "--images", 0, "--out", tmp_path / "compared", "--json").ok()
    fine, coarse = compared.result["takes"]
    assert fine["measures"]["psnr"] > coarse["measures"]["psnr"]

    assert check_take(take, STAGE_NAMES).damage == ()
    here("evaluate", take.root).ok()
    psnr = {kept.name: kept.psnr for kept in kept_bakes(take)}
    assert psnr["coarse"] < measured, "what is measured later belongs to the kept bake too"
    assert "coarse" in here("bake", "list", take.root).stdout


@pytest.mark.parametrize(
    "name", ["", "..", "a/b", ".hidden", "a\\b", "end.", "x" * 61, "new\nline", "CON", "a.partial"]
)
def test_names_that_are_no_folders_are_refused(take: Take, name: str) -> None:
    with refuses("bakes.invalid_name"):
        keep_bake(take, name)
    assert not take.bakes.exists()


def test_a_name_is_the_same_in_each_form_of_its_letters(take: Take) -> None:
    """macOS types "é" as two characters."""
    assert keep_bake(take, "cafe\u0301").name == "caf\u00e9"
    with refuses("bakes.name_taken"):
        keep_bake(take, "caf\u00e9")


def test_a_stream_that_is_not_the_recorded_one_is_not_kept(take: Take) -> None:
    """The manifest is as after another program replaced it."""
    manifest = take.stream / "manifest.json"
    text = manifest.read_text()
    manifest.write_text(text.replace("1", "2", 1))
    with refuses("take.damaged", file=manifest):
        keep_bake(take, "fine")
    take.forget("bake")
    with refuses("bakes.not_baked"):
        keep_bake(take, "other")
    assert not take.bakes.exists()


def test_check_names_damage_of_a_kept_bake(take: Take, here: Callable) -> None:
    keep_bake(take, "fine")
    path = next((take.bakes / "fine" / "stream" / "files").iterdir())
    data = path.read_bytes()
    replace_file(path, data[:-5])
    said = here("check", take.root, "--remove").fails().stdout
    assert f"changed: {path.relative_to(take.root)}" in said
    assert f"rm -r {take.bakes / 'fine'}" in said
    assert path.is_file()
    here("status", take.root, "--check").ok()  # no run makes it again, so no stage is forgotten
    record = Take(take.bakes / "fine").record("bake")
    replace_file(record, b"{")
    assert kept_bakes(take) == []
    assert f"damaged: {record.relative_to(take.root)} (" in here("check", take.root).fails().stdout


def test_kept_bakes_are_removed(take: Take, here: Callable) -> None:
    first = contents(take.stream)
    here("bake", "keep", take.root, "fine").ok()
    here("bake", "remove", take.root, "fine", "other").fails()
    assert [kept.name for kept in kept_bakes(take)] == ["fine"]
    here("bake", "remove", take.root, "fine").ok()
    assert kept_bakes(take) == []
    assert contents(take.stream) == first


def test_settings_that_differ_from_those_of_a_kept_bake_are_named(take: Take, here: Callable) -> None:
    wav = write_wav(take.root / "a.wav", clicks(0.3, [0.08]))
    assert "capture.frames" not in keep_bake(take, "silent").settings, "training depends on it"
    others = ("--capture.audio", wav, "--bake.attribute_qps", "{sh: 40}", "--evaluate.background", "1,1,1")
    measured = ("--capture.fps", "50", "--evaluate.crop_padding", "3")
    here("bake", take.root, *others, *measured, "--keep", "loud", "--bake.quality", "40").ok()
    changed = ["bake.attribute_qps", "capture.audio", "capture.fps", "evaluate.background", "evaluate.crop_padding"]
    rows = here("bake", "list", take.root, "--json").result["bakes"]
    assert {row["name"]: sorted(row["other_settings"]) for row in rows} == {"silent": changed, "loud": []}
    assert "evaluate.background" in here("bake", "list", take.root).stdout


def test_a_bake_is_kept_with_the_settings_and_edits_that_it_was_made_with(take: Take, here: Callable) -> None:
    before = load_config(take.config)
    changed = {"bake.quality": 30, "bake.attribute_qps": {"sh": 40}, "capture.fps": 50, "capture.offsets": {"cam1": 1}}
    changed["capture.root"] = os.path.relpath(before.capture.root, take.root)
    set_settings(take.config, {**changed, "train.dilation": 0.2, "evaluate.crop_padding": 3})
    here("edit", "trim", take.root, "1:3").ok()
    kept = keep_bake(take, "fine").take
    assert load_config(kept.config) == before
    assert read_edits(kept.edits) == EditList() != read_edits(take.edits)


def test_a_kept_bake_knows_that_training_saw_the_crop_box(take: Take) -> None:
    box = {"center": (0, 0, 0), "size": (9, 9, 9)}
    for stage in ("train", "bake"):
        record = json.loads(take.record(stage).read_bytes())
        record["params"]["edits.crop"] = box
        take.record(stage).write_text(json.dumps(record))
    assert read_edits(keep_bake(take, "fine").take.edits) == EditList(crop=CropBox(**box, training=True))


def test_a_bake_is_current_if_all_that_it_was_made_from_is(take: Take) -> None:
    kept = keep_bake(take, "fine")
    assert kept.current
    params = {**kept.record.params, "result of calibrate": "of others"}  # fine-tuned renditions have cameras, too
    replace_file(kept.take.record("bake"), kept.record.model_copy(update={"params": params}).model_dump_json().encode())
    assert not kept_bakes(take)[0].current
