"""Edits in words."""

from __future__ import annotations

from typing import Any

import pytest

from pipelines.takes.edit_words import describe, words_of
from studio.edits.edit_list import CropBox, DetailMark, EditList, Floaters, Ground, Trim, World
from studio.similarity import Similarity


@pytest.mark.parametrize(
    ("edit", "words"),
    [
        (Trim(first=3, last=12), "frames 3 to 12"),
        (World(scale=2.5), "scale 2.5"),
        (World(origin=(0, 1.5, 0)), "origin (0, 1.5, 0)"),
        (World(up=(0, -1, 0), origin=(1, 0, 0), scale=0.01), "up (0, -1, 0), origin (1, 0, 0), scale 0.01"),
        (World(), "as captured"),
        (Ground(normal=(0, 1, 0), height=-0.25), "nothing below -0.25 along (0, 1, 0)"),
        (CropBox(center=(0, 1, 0), size=(1, 2, 1)), "box of 1 x 2 x 1 around (0, 1, 0)"),
        (
            CropBox(center=(0, 1, 0), size=(1, 2, 1), training=True),
            "box of 1 x 2 x 1 around (0, 1, 0), also for training",
        ),
        (
            Floaters(opacity=0.05, share=0.01),
            "splats that never reach opacity 0.05, clusters of less than 1% of the splats",
        ),
    ],
)
def test_each_edit_in_words(edit: Any, words: str) -> None:
    assert words_of(edit, Similarity()) == words


def test_positions_and_sizes_are_those_of_the_placed_world() -> None:
    edits = EditList(
        world=World(up=(0, 0, 1), origin=(0, 0, 2), scale=10),
        crop=CropBox(center=(0, 0, 3), size=(1, 2, 3)),
        ground=Ground(normal=(0, 0, 1), height=2.5),
        details=(DetailMark(radius=0.1, path=((0, (0, 0, 3.5)), (9, (0, 0, 4)))),),
    )
    assert describe(edits) == {
        "world": "up (0, 0, 1), origin (0, 0, 2), scale 10",
        "crop": "box of 10 x 20 x 30 around (0, 10, 0)",
        "ground": "nothing below 5 along (0, 1, 0)",
        "details 1": "radius 1, weight 4, frames 0 to 9, in the first at (0, 15, 0)",
    }


def test_only_what_is_edited_is_listed() -> None:
    assert describe(EditList()) == {}
    found = describe(EditList(world=World(scale=2), trim=Trim(first=0, last=4)))
    assert found == {"trim": "frames 0 to 4", "world": "scale 2"}
