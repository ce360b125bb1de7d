"""Cards of the start page, against the files of takes and `v3studio status`."""

from __future__ import annotations

import json
import os
import re
import shutil
import time
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest

from gui.pages.start import thumbnail as thumbnails
from gui.pages.start.cards import Card, date_words, describe, folder_bytes, megabytes, state_words
from gui.pages.start.thumbnail import SIZE, cropped, thumbnail
from pipelines.runs.staleness import StageStatus
from pipelines.takes.take import Take

STAGES = ("calibrate", "initialize", "train", "bake", "evaluate")


def test_a_finished_take(finished: Path) -> None:
    take = finished / "take"
    card = describe(str(take))
    assert (card.kind, card.name, card.state, card.tone) == ("take", "take", "all stages done", "done")
    evaluation = json.loads((take / "evaluation.json").read_text())
    rows = [frame["psnr_decoded"] for frame in evaluation["frames"]]
    assert card.psnr == pytest.approx(sum(rows) / len(rows), abs=0.02)
    assert card.stream_bytes == sum(path.stat().st_size for path in (take / "stream").rglob("*") if path.is_file())
    assert card.total_bytes == sum(path.stat().st_size for path in take.rglob("*") if path.is_file())


def test_a_setting_that_was_changed_shows(take_copy: Path) -> None:
    config = take_copy / "config.yaml"
    before = config.read_text()
    config.write_text(re.sub(r"\bqp: \d+", "qp: 41", before))
    assert config.read_text() != before
    assert describe(str(take_copy)).state == "Bake and Review stale"
    shutil.rmtree(take_copy / "train")
    assert describe(str(take_copy)).tone != "done"


def test_what_is_not_a_take_is_told(take_copy: Path, tmp_path: Path) -> None:
    gone = describe(str(tmp_path / "gone"))
    assert (gone.kind, gone.tone) == ("missing", "failed")
    stream = describe(str(take_copy / "stream"))
    assert (stream.kind, stream.stream_bytes) == ("stream", folder_bytes(take_copy / "stream"))
    assert describe("https://example.org/walk").kind == "web"
    (take_copy / "take.json").write_text('{"format": 99}')
    damaged = describe(str(take_copy))
    assert damaged.kind == "damaged"
    assert "format 99" in damaged.state
    (tmp_path / "empty").mkdir()
    assert "neither a take nor a stream" in describe(str(tmp_path / "empty")).state


def test_a_running_take_is_not_measured_at_each_look(take_copy: Path) -> None:
    measured = describe(str(take_copy))
    sizes = (measured.stream_bytes, measured.total_bytes)
    (take_copy / "new.bin").write_bytes(bytes(1000))
    with Take(take_copy).locked("v3studio run"):
        running = describe(str(take_copy), sizes)
        again = describe(str(take_copy))
    assert (running.tone, (running.stream_bytes, running.total_bytes)) == ("running", sizes)
    assert again.total_bytes is not None
    assert sizes[1] is not None
    assert again.total_bytes >= sizes[1] + 1000
    after = describe(str(take_copy), sizes)
    assert after.total_bytes is not None
    assert (after.tone, after.total_bytes >= sizes[1] + 1000) == ("done", True)


@pytest.mark.parametrize(
    ("states", "words"),
    [
        (("done",) * 5, ("all stages done", "done")),
        (("missing",) * 5, ("not started", "missing")),
        (("done", "done", "missing", "missing", "missing"), ("next: Train", "missing")),
        (("done", "done", "done", "stale", "stale"), ("Bake and Review stale", "stale")),
        (("done", "failed", "missing", "missing", "missing"), ("Initialize failed", "failed")),
        (("done", "done", "partial", "missing", "missing"), ("Train: 3 of 30 frames", "stale")),
    ],
)
def test_states_are_words(states: tuple[str, ...], words: tuple[str, str]) -> None:
    found = {name: StageStatus(name, state, "", 3, 30, "frames") for name, state in zip(STAGES, states, strict=True)}
    assert state_words(found) == words


def test_sizes_and_dates_are_words() -> None:
    assert [megabytes(count) for count in (84_900, 1_930_000, 213_600_000, 1_200_000_000)] == [
        "84.9 KB", "1.93 MB", "214 MB", "1.20 GB",
    ]  # fmt: skip
    now = datetime(2026, 3, 12, 10, 0).timestamp()
    moments = [(2026, 3, 12, 9, 5), (2026, 3, 11, 23, 59), (2026, 3, 3, 8, 0), (2025, 12, 31, 8, 0)]
    words = [date_words(datetime(*moment).timestamp(), now) for moment in moments]
    assert words == ["today 09:05", "yesterday 23:59", "3 Mar", "31 Dec 2025"]
    assert date_words(None) == ""


def test_a_card_tells_its_sizes_in_fewer_words_where_there_is_less_room() -> None:
    words = Card("/takes/walk", "take", stream_bytes=84_900, total_bytes=8_150_000).sizes()
    assert all("84.9 KB" in one and "8.15 MB" in one for one in words)
    assert [len(one) for one in words] == sorted({len(one) for one in words}, reverse=True)
    assert Card("/takes/walk", "take", total_bytes=8_150_000).sizes() == ("8.15 MB in all",)
    assert Card("/walk", "stream", stream_bytes=84_900, total_bytes=84_900).sizes() == ("84.9 KB stream",)
    assert Card("https://example.org/walk", "web").sizes() == ()


def test_the_home_folder_is_short(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", str(tmp_path / "anna"))
    assert Card(str(tmp_path / "anna" / "takes" / "walk"), "take").folder == "~/takes"
    assert Card(str(tmp_path / "annabel" / "walk"), "take").folder == str(tmp_path / "annabel")
    assert Card("https://example.org/walk/", "web").name == "walk"


def test_a_thumbnail_is_drawn_once(finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    take = str(finished / "take")
    first = thumbnail(take)
    assert first is not None
    assert first.shape == (SIZE[1], SIZE[0], 3)
    corner, middle = (
        first[:20, :20],
        first[SIZE[1] // 2 - 20 : SIZE[1] // 2 + 20, SIZE[0] // 2 - 20 : SIZE[0] // 2 + 20],
    )
    assert np.abs(middle.astype(int).mean((0, 1)) - corner.astype(int).mean((0, 1))).max() > 30, "the ball is there"
    monkeypatch.setattr(thumbnails, "_made", lambda place: pytest.fail("drawn again"))
    again = thumbnail(take)
    assert again is not None
    np.testing.assert_array_equal(again, first)
    assert thumbnail("https://example.org/walk") is None


def test_a_take_without_results_shows_its_footage(
    take_copy: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    drawn = thumbnail(str(take_copy))
    for name in ("train", "stream"):
        shutil.rmtree(take_copy / name)
    later = time.time() + 5
    os.utime(take_copy / "config.yaml", (later, later))
    filmed = thumbnail(str(take_copy))
    assert filmed is not None
    assert drawn is not None
    assert np.abs(filmed.astype(int) - drawn).mean() > 5


def test_images_fill_a_thumbnail_without_being_distorted() -> None:
    tall = np.zeros((400, 200, 3), np.uint8)
    tall[190:210] = 255
    found = cropped(tall)
    assert found.shape == (SIZE[1], SIZE[0], 3)
    rows = np.flatnonzero(found[:, 240, 0] > 127)
    assert len(rows) == pytest.approx(20 * SIZE[0] / 200, abs=3)
    assert rows.mean() == pytest.approx(SIZE[1] / 2, abs=2)
