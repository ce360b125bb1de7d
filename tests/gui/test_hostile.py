"""Damaged streams and takes in the real window, one after the other: each is reported, and the window stays."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path

from tests.gui.conftest import RunningWindow
from tests.support.streams import edit_manifest, group_files, set_at

DRIVER = Path(__file__).parents[1] / "support" / "driven_window.py"

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
"""The words by which the window reports each."""

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
    open_window: Callable[..., RunningWindow], stream_folder: Path, finished: Path, tmp_path: Path
) -> None:
    for name in REPORTED:
        shutil.copytree(stream_folder if name in STREAMS else finished / "take", tmp_path / name)
    _damage(tmp_path)
    paths, results = tmp_path / "paths.json", tmp_path / "results.jsonl"
    paths.write_text(json.dumps([str(tmp_path / name) for name in REPORTED]))
    window = open_window(program=(DRIVER, paths, results))
    status, errors = window.process.wait(480), window.stderr.read_text(errors="replace")
    rows = {Path(row["path"]).name: row for row in map(json.loads, results.read_text().splitlines())}
    assert list(rows) == list(REPORTED), errors[-3000:]
    assert status == 0
    assert "Traceback" not in errors
    assert "top-level" not in errors, "Open3D draws more than 20 widgets of a window wrongly"
    for name, row in rows.items():
        assert row["opened"] == (name not in NOT_OPENED), name
        assert REPORTED[name] in "\n".join(row["sentences"]), name
        assert not row["dialog"], name
        assert not row["unsettled"], name
        assert not [text for text in row["sentences"] if "a bug in V3 Studio" in text], name
