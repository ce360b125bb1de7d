"""Damaged and hostile streams and takes in the real window, one after the other: a sentence each, and no end."""

from __future__ import annotations

import shutil
from pathlib import Path

from tests.support.driven_window import drive
from tests.support.streams import edit_manifest, set_at


def test_the_window_says_what_is_wrong_and_goes_on(
    display: str, stream_folder: Path, finished_project: Path, tmp_path: Path
) -> None:
    for name in ("newer", "half", "whole"):
        shutil.copytree(stream_folder, tmp_path / name)
    for name in ("rot", "deep", "no take"):
        shutil.copytree(finished_project / "take", tmp_path / name)
    edit_manifest(tmp_path / "newer", set_at(("version",), 999))
    for video in (tmp_path / "half").rglob("*.mp4"):
        video.write_bytes(video.read_bytes()[:100])
    for frame in (tmp_path / "rot" / "train").rglob("*.safetensors"):
        data = bytearray(frame.read_bytes())
        data[-1] ^= 1
        frame.write_bytes(data)
    (tmp_path / "deep" / "config.yaml").write_text("[" * 100_000)
    (tmp_path / "no take" / "take.json").write_text('{"format": 1e400}')

    names = ("newer", "half", "rot", "deep", "no take", "whole")
    shown, errors, status = drive(display, [tmp_path / name for name in names], tmp_path / "window")
    assert [Path(one.path).name for one in shown] == list(names), errors[-3000:]
    assert status == 0
    assert "Traceback" not in errors
    assert [one.opened for one in shown] == [False, False, True, True, False, True]
    said = {Path(one.path).name: "\n".join(one.sentences) for one in shown}
    assert "999" in said["newer"]
    assert "the file has 100 bytes" in said["half"]
    assert "result files were modified" in said["rot"]
    assert "nested" in said["deep"]
    assert "take.json" in said["no take"]
    assert [(one.path, one.dialog, one.unsettled) for one in shown if one.dialog or one.unsettled] == []
    assert not [text for one in shown for text in one.sentences if "a bug in V3 Studio" in text]
