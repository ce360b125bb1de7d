import json
import os
import shutil
import time
from pathlib import Path

import numpy as np
import pytest

from v3studio.gui.pages.start import cards
from v3studio.gui.pages.start import thumbnail as thumbnails
from v3studio.gui.pages.start.cards import describe, folder_bytes
from v3studio.gui.pages.start.thumbnail import SIZE, thumbnail
from v3studio.pipelines.takes.take import Take


def test_a_finished_take(finished: Path) -> None:
    take = finished / "take"
    card = describe(str(take))
    assert (card.kind, card.name, card.words, card.state) == ("take", "take", "all stages done", "done")
    evaluation = json.loads((take / "evaluation.json").read_text())
    rows = [frame["psnr_decoded"] for frame in evaluation["frames"]]
    assert card.quality == pytest.approx(sum(rows) / len(rows), abs=0.02)
    assert card.stream_bytes == sum(path.stat().st_size for path in (take / "stream").rglob("*") if path.is_file())
    assert card.total_bytes == sum(path.stat().st_size for path in take.rglob("*") if path.is_file())


def test_a_running_take_is_measured_now_and_then(take_copy: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cards, "MEASURE_EVERY", 1e9)
    with Take.open(take_copy).locked("test"):
        before = describe(str(take_copy))
        (take_copy / "new").write_bytes(bytes(1000))
        assert describe(str(take_copy)) == before
        monkeypatch.setattr("v3studio.pipelines.runs.status.is_paused", lambda pid: pid == os.getpid())
        assert describe(str(take_copy)).words == "paused"
    assert describe(str(take_copy)).total_bytes == folder_bytes(take_copy)


def test_what_is_not_a_take_is_told(take_copy: Path, tmp_path: Path) -> None:
    gone = describe(str(tmp_path / "gone"))
    assert (gone.kind, gone.state) == ("missing", "failed")
    stream = describe(str(take_copy / "stream"))
    assert (stream.kind, stream.stream_bytes) == ("stream", folder_bytes(take_copy / "stream"))
    assert describe("https://example.org/walk").kind == "web"
    (take_copy / "take.json").write_text('{"format": 99}')
    damaged = describe(str(take_copy))
    assert damaged.kind == "damaged"
    assert "format 99" in damaged.words
    (tmp_path / "empty").mkdir()
    assert "neither a take nor a stream" in describe(str(tmp_path / "empty")).words


def test_a_thumbnail_is_drawn_once(finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    take = str(finished / "take")
    first = thumbnail(take)
    assert first.shape == (SIZE[1], SIZE[0], 3)
    corner, (x, y) = first[:20, :20], (SIZE[0] // 2, SIZE[1] // 2)
    middle = first[y - 20 : y + 20, x - 20 : x + 20]
    assert np.abs(middle.astype(int).mean((0, 1)) - corner.astype(int).mean((0, 1))).max() > 30, "the ball is there"
    monkeypatch.setattr(thumbnails, "draw", lambda *_: pytest.fail("drawn again"))
    np.testing.assert_array_equal(thumbnail(take), first)
    assert thumbnail("https://example.org/walk") is None


def test_without_results_it_shows_footage(take_copy: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    drawn = thumbnail(str(take_copy))
    for name in ("train", "stream"):
        shutil.rmtree(take_copy / name)
    later = time.time() + 5
    os.utime(take_copy / "config.yaml", (later, later))
    filmed = thumbnail(str(take_copy))
    assert np.abs(filmed.astype(int) - drawn).mean() > 5
