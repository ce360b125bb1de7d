"""Messages of the command line in the words of the window's pages."""

import pytest

from gui.models.take.page_words import in_page_words, why_not_done
from pipelines.runs.staleness import StageStatus


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("bake.quality changed from 22 to 30", "'quality' in Bake changed from 22 to 30"),
        ("using 30 fps (set capture.fps).", "using 30 fps (set 'frame rate (fps)' in Capture)."),
        ("Run `v3studio initialize TAKE --force`.", "Run Initialize again."),
        ("Run `v3studio run` or `v3studio bake`.", "Run all stages or Bake."),
        (
            "train/group_000/frame_000000.safetensors was deleted",
            "train/group_000/frame_000000.safetensors was deleted",
        ),
        ("/data/train.max_splats: train.no_such_setting", "/data/train.max_splats: train.no_such_setting"),
        ("See `v3studio edit list TAKE`.", "See `v3studio edit list TAKE`."),
    ],
)
def test_settings_and_stages_have_the_names_on_screen(text: str, shown: str) -> None:
    assert in_page_words(text) == shown


@pytest.mark.parametrize(
    ("needs", "shown"),
    [
        (("train",), "Run Train first."),
        (("train", "bake"), "Run Train and Bake first."),
        (("initialize", "train", "bake"), "Run Initialize, Train and Bake first."),
    ],
)
def test_stages_that_wait_for_others_say_so(needs: tuple[str, ...], shown: str) -> None:
    assert why_not_done(StageStatus("evaluate", "stale", needs=needs)) == shown
