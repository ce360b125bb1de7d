"""Damaged streams and takes in the real window, one after the other: each is reported, and the window stays."""

import shutil
from pathlib import Path

from tests.support.driven_window import drive
from tests.support.streams import edit_manifest, group_files, set_at

REPORTED = {
    "newer": "999",
    "half": "the file has 100 bytes",
    "rot": "result files were modified",
    "deep": "nested",
    "no take": "take.json",
    "format": "format 99",
    "settings": "config.yaml",
    "unknown": "the log has the rest",
    "manifest": "manifest.json",
    "group": "files/",
    "rig": "rig.json",
    "frame": "",
    "evaluation": "",
    "whole": "",
}
"""What the window reports of each."""

STREAMS = ("newer", "half", "whole")
NOT_OPENED = ("newer", "half", "no take", "format")


def _damage(root: Path) -> None:
    edit_manifest(root / "newer", set_at(("version",), 999))
    for video in (root / "half").rglob("*.mp4"):
        video.write_bytes(video.read_bytes()[:100])
    for frame in (root / "rot" / "train").rglob("*.safetensors"):
        data = bytearray(frame.read_bytes())
        data[-1] ^= 1
        frame.write_bytes(data)
    victim = group_files(root / "group" / "stream", 0)[0]
    victim.write_bytes(victim.read_bytes()[:-20])
    for file, text in (
        ("deep/config.yaml", "[" * 100_000),
        ("no take/take.json", '{"format": 1e400}'),
        ("format/take.json", '{"format": 99}'),
        ("settings/config.yaml", "train: ["),
        ("unknown/config.yaml", "train:\n" + "".join(f"  setting_{number}: 1\n" for number in range(200))),
        ("manifest/stream/manifest.json", "{"),
        ("rig/calibrate/rig.json", "[]"),
        ("frame/train/group_000/frame_000000.safetensors", "x"),
        ("evaluation/evaluation.json", "null"),
    ):
        (root / file).write_text(text)


def test_the_window_reports_damage_and_stays(
    display: str, stream_folder: Path, finished_project: Path, tmp_path: Path
) -> None:
    for name in REPORTED:
        shutil.copytree(stream_folder if name in STREAMS else finished_project / "take", tmp_path / name)
    _damage(tmp_path)
    shown, errors, status = drive(display, [tmp_path / name for name in REPORTED], tmp_path / "window")
    found = {Path(one.path).name: one for one in shown}
    assert list(found) == list(REPORTED), errors[-3000:]
    assert status == 0
    assert "Traceback" not in errors
    assert "top-level" not in errors, "Open3D draws more than 20 widgets of a window wrongly"
    for name, one in found.items():
        assert one.opened == (name not in NOT_OPENED), name
        assert REPORTED[name] in "\n".join(one.sentences), name
        assert not one.dialog, name
        assert not one.unsettled, name
        assert not [text for text in one.sentences if "a bug in V3 Studio" in text], name
