from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.studio.capture.test_timecode import film
from tests.support.tiny_capture import Here


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--square", "abc"), "argument --square: 'abc' is not a number; example: 2.5"),
        (("--square", "nan"), "argument --square: 'nan' is not a number"),
        (("--columns", "5.5"), "argument --columns: '5.5' is not an integer; example: 24"),
        (("--square", "-5"), "--square -5 is not between 0 and 10000 mm"),
        (("--square", "0", "--kind", "chessboard"), "--square 0 is not between 0 and 10000 mm"),
    ],
)
def test_a_boards_sizes_are_in_millimeters(here: Here, tmp_path: Path, options: tuple[str, ...], said: str) -> None:
    here("board", tmp_path / "b.pdf", *options).fails(said, code=2)
    assert not (tmp_path / "b.pdf").exists()


def test_sync_refuses_offsets_of_cameras_that_are_not_there(here: Here, tmp_path: Path) -> None:
    """A square moves in 14 frames."""
    for name in ("left", "right"):
        folder = tmp_path / "capture" / "images" / name
        folder.mkdir(parents=True)
        for frame in range(14):
            image = np.zeros((48, 64, 3), np.uint8)
            image[10:20, (at := (frame * frame) % 50) : at + 10] = 255
            assert cv2.imwrite(str(folder / f"{frame}.png"), image)
    moving = tmp_path / "two.yaml"
    moving.write_text("capture: {root: capture, rig: null, masks: none}\n")
    here("sync", moving, "--capture.offsets", "{lefd: 2}").fails("Did you mean 'left'?")
    moving.write_text("capture: {root: capture, rig: null, masks: none, offsets: {z: 1}}\n")
    here("sync", moving).fails("no camera 'z' in the footage")
    here("sync", moving, "--capture.offsets", "{left: 2}").ok()  # looked for again, not applied


def test_sync_by_timecode_prints_the_offsets_to_set(here: Here, tmp_path: Path) -> None:
    (tmp_path / "videos").mkdir()
    for name, label in (("left", "23:59:59:24"), ("right", "00:00:00:02")):
        film(tmp_path / "videos" / f"{name}.mp4", label)
    (tmp_path / "two.yaml").write_text("capture: {root: ., rig: null, masks: none}\n")
    lines = here("sync", tmp_path / "two.yaml", "--method", "timecode").ok().stdout.splitlines()
    assert lines[:2] == ["left: +0 frames (timecode 23:59:59:24)", "right: -3 frames (timecode 00:00:00:02)"]
    assert lines[-1] == "capture: {offsets: {right: -3}}"
    result = here("sync", tmp_path / "two.yaml", "--method", "timecode", "--json").result
    assert result["timecodes"] == {"left": "23:59:59:24", "right": "00:00:00:02"}
    assert result["whole"] == {"right": -3}
