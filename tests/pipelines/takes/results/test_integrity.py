import json
import os
from collections.abc import Callable
from pathlib import Path

import pytest
import torch
from safetensors.torch import load_file

from tests.support import streams
from tests.support.errors import refuses
from v3studio.pipelines.stages import STAGE_NAMES
from v3studio.pipelines.takes.authored.edits import change_edits
from v3studio.pipelines.takes.frames.frame_files import read_frame
from v3studio.pipelines.takes.results.integrity import check_take
from v3studio.pipelines.takes.take import Take
from v3studio.studio.camera_files import read_rig
from v3studio.studio.edits.edit_list import EditList, Trim
from v3studio.studio.formats.camera_path import Key, write_path_keys

FRAME = "train/group_000/frame_000001.safetensors"


def flip(path: Path) -> None:
    """Change one bit; size and modification time stay."""
    stat = path.stat()
    streams.flip(path)
    os.utime(path, ns=(stat.st_atime_ns, stat.st_mtime_ns))


def test_a_take_as_it_was_written_is_whole(take: Take) -> None:
    checked = check_take(take, STAGE_NAMES)
    assert (checked.damage, checked.unchecked) == ((), ())
    files = [path for path in take.root.rglob("*") if path.is_file() and ".v3studio" not in path.parts]
    # no stage uses these as input
    notes = {"take.json", "config.yaml", "report.json", "verdict.json", "card.json", "card.jpg", "group.json"}
    assert checked.files == len([path for path in files if path.name not in notes])


def test_one_bit_in_any_result_is_found(take: Take) -> None:
    for name in ("calibrate/rig.json", "initialize/group_001/points.ply", FRAME, "evaluation.json"):
        flip(take.root / name)
        checked = check_take(take, STAGE_NAMES)
        assert [(damage.file, damage.problem) for damage in checked.damage] == [(name, "changed")]
        flip(take.root / name)
    (take.root / FRAME).unlink()
    assert [damage.problem for damage in check_take(take, STAGE_NAMES).damage] == ["missing"]


def test_a_damaged_frame_is_refused_where_it_is_read(take: Take) -> None:
    whole = load_file(take.root / FRAME)
    assert torch.equal(read_frame(take.root / FRAME).means, whole["means"])
    flip(take.root / FRAME)
    with refuses("take.damaged", file=take.root / FRAME):
        read_frame(take.root / FRAME)


def test_the_command_names_removes_and_a_run_repairs(take: Take, here: Callable) -> None:
    here("check", take.root).ok()
    video = next((take.stream).rglob("*.mp4"))
    whole = video.read_bytes()
    flip(video)
    checked = here("check", take.root, "--json").fails().result["damage"]
    name = video.relative_to(take.root).as_posix()
    assert checked == [{"file": name, "stage": "bake", "problem": "changed", "detail": ""}]
    assert name in here("check", take.root, "--remove").fails().stdout
    assert not video.exists()
    here("run", "--take", take.root).ok()
    assert video.read_bytes() == whole
    here("check", take.root).ok()


def test_what_people_made_is_read(take: Take, here: Callable) -> None:
    take.marks.write_text('{"marks": [{"frame": 1, "note": "good"}]}')
    change_edits(take.edits, EditList(trim=Trim(first=1, last=3)), "trim")
    write_path_keys([Key(0.0, next(iter(read_rig(take.rig))))], take.camera_path)
    take.garbage.write_text("cam1: {remove: [[[0, 0], [64, 0], [64, 48]]]}")
    assert check_take(take, STAGE_NAMES).damage == ()
    take.garbage.write_text("cam1: {remove: [[[0, 0], [64, 0]]]}")
    take.marks.write_text('{"marks": [{"frame": -1, "note": "good"}]}')
    take.edits.write_text("{")
    take.camera_path.write_text("")
    checked = check_take(take, STAGE_NAMES).damage
    assert [damage.file for damage in checked] == ["edits.json", "marks.json", "garbage.yaml", "camera_path.json"]
    assert all(damage.detail and (damage.stage, damage.problem) == ("", "damaged") for damage in checked)
    said = here("check", take.root, "--remove").fails().stdout
    assert "Not made by a run: edits.json, marks.json, garbage.yaml, camera_path.json. Copy back a backup" in said
    assert "rm -r" not in said
    assert take.edits.read_text() == "{"


def test_footage_is_read_and_described(here: Callable, project: Path) -> None:
    footage = project / "capture"
    assert "6 cameras, 5 frames" in here("check", footage).ok().stdout
    broken = footage / "images" / "cam2" / "003.png"
    broken.write_bytes(broken.read_bytes()[:100])
    (problem,) = here("check", footage, "--json").fails().result["problems"]
    assert str(broken) in problem
    (footage / "cameras.json").write_text("{")
    assert len(here("check", footage, "--json").fails().result["problems"]) == 2  # as a run says
    for camera in (footage / "images").iterdir():
        for path in camera.iterdir():
            path.rename(path.with_suffix(".heic"))
    assert ".heic" in here("check", footage).fails().stderr
    (project / "empty").mkdir()
    here("check", project / "empty").fails()  # neither a take nor footage


@pytest.mark.parametrize(
    "name", ["../victim/file", ".", "/etc/passwd", "stream/../../victim/file", "a" * 300, "a\0b", "", "link/file"]
)
def test_a_record_names_files_of_its_take_only(take: Take, here: Callable, name: str) -> None:
    """Takes are exchanged: a record is somebody else's word."""
    victim = take.root.parent / "victim"
    victim.mkdir()
    (victim / "file").write_text("mine")
    (take.root / "link").symlink_to(victim)
    record = json.loads(take.record("bake").read_text())
    record["files"][name] = 3
    record["digests"][name] = "0" * 24
    take.record("bake").write_text(json.dumps(record))
    here("check", take.root, "--remove")
    assert (victim / "file").read_text() == "mine"
    assert (take.root / "take.json").is_file()
    if name != "link/file":
        assert check_take(take, STAGE_NAMES).unchecked == ("bake",)
