from pathlib import Path

import pytest

from tests.support.errors import refuses
from tests.support.rigs import camera_at
from v3studio.pipelines.takes.authored.edits import (
    MOST_STEPS,
    change_edits,
    describe,
    read_edits,
    read_edits_file,
    step_edits,
)
from v3studio.studio.edits.edit_list import CropBox, DetailMark, EditList, Ground, Region, RegionView, Trim, World


def trimmed(last: int) -> EditList:
    return EditList(trim=Trim(first=0, last=last))


def test_changes_are_undone_and_made_again(tmp_path: Path) -> None:
    path = tmp_path / "edits.json"
    assert read_edits(path) == EditList()
    with refuses("take.nothing_to_undo"):
        step_edits(path, "undo")
    assert not path.exists()
    change_edits(path, trimmed(3), "trim to 3", EditList())
    change_edits(path, trimmed(3), "the same")
    change_edits(path, trimmed(5), "trim to 5", trimmed(3))
    assert step_edits(path, "undo") == "trim to 5"
    assert step_edits(path, "undo") == "trim to 3"
    assert read_edits(path) == EditList()
    step_edits(path, "redo")
    assert read_edits(path) == trimmed(3)
    change_edits(path, trimmed(7), "trim to 7")
    with refuses("take.nothing_to_redo"):
        step_edits(path, "redo")
    with refuses("take.edits_changed"):
        change_edits(path, trimmed(8), "trim to 8", trimmed(3))
    for last in range(MOST_STEPS + 10):
        change_edits(path, trimmed(last), "again")
    assert len(read_edits_file(path).undo) == MOST_STEPS


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("{", "take.edits_damaged"),
        ("[]", "take.edits_damaged"),
        ('{"format": 2}', "take.edits_unknown_format"),
        ('{"format": 1, "edits": {"trim": {"first": 3}}}', "take.edits_damaged"),
        ('{"format": 1, "edits": {"new": 3}}', "take.edits_damaged"),
    ],
)
def test_other_files_are_refused_and_stay(tmp_path: Path, text: str, code: str) -> None:
    path = tmp_path / "edits.json"
    path.write_text(text)
    with refuses(code, file=path):
        change_edits(path, trimmed(3), "trim")
    assert path.read_text() == text


def test_positions_and_sizes_are_those_of_the_placed_world() -> None:
    view = RegionView.of(camera_at("view", (2, 0, 1)))
    lasso = Region(view=view, outline=((0, 0), (9, 0), (0, 9)))
    brush = Region(view=view, outline=((0, 0),), radius=3, near=1, far=2.5, frames=(3, 3))
    edits = EditList(
        regions=(lasso, brush, brush.model_copy(update={"frames": (3, 8), "far": None})),
        world=World(up=(0, 0, 1), origin=(0, 0, 2), scale=10),
        crop=CropBox(center=(0, 0, 3), size=(1, 2, 3)),
        ground=Ground(normal=(0, 0, 1), height=2.5),
        details=(DetailMark(radius=0.1, path=((0, (0, 0, 3.5)), (9, (0, 0, 4)))),),
    )
    assert describe(edits) == {
        "world": "up (0, 0, 1), origin (0, 0, 2), scale 10",
        "crop": "box of 10 x 20 x 30 around (0, 10, 0)",
        "ground": "nothing below 5 along (0, 1, 0)",
        "regions 1": "lasso, all frames",
        "regions 2": "brush, the group of frame 3, depth 10 to 25",
        "regions 3": "brush, frames 3 to 8",
        "details 1": "radius 1, weight 4, frames 0 to 9, in the first at (0, 15, 0)",
    }
