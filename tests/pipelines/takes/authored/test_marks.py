from pathlib import Path

import pytest

from tests.support.errors import refuses
from v3studio.pipelines.takes.authored.marks import Mark, change_mark, read_marks


@pytest.mark.parametrize("frame", ["true", "1.9", "-5", "1e400", '"7"', "null", "[]", "9" * 5000])
def test_a_frame_is_a_whole_number(tmp_path: Path, frame: str) -> None:
    path = tmp_path / "marks.json"
    path.write_text(f'{{"marks": [{{"frame": {frame}, "note": "x"}}]}}')
    with refuses("take.marks_damaged") as caught:
        read_marks(path)
    assert len(str(caught.value)) < 500
    path.write_text('{"marks": [{"frame": 7, "note": "x"}]}')
    assert read_marks(path)[7].note == "x"


def test_a_take_that_was_removed_is_not_made_again_by_a_mark(tmp_path: Path) -> None:
    with refuses("take.not_found"):
        change_mark(tmp_path / "gone" / "marks.json", 7, Mark(frame=7, note="x"), None)
    assert not (tmp_path / "gone").exists()
