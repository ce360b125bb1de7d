from pathlib import Path

from gui.models.playback.other_source import OTHER, open_other
from gui.models.playback.player import PlayerPresenter
from gui.models.playback.timeline_plots import plots_of
from gui.models.take.bakes import Bakes, bake_words
from pipelines.takes.settings_file import set_settings
from pipelines.takes.take import Take
from tests.support.looping import wait_in_loop
from tests.support.players import settle


def test_up_to_four_are_side_by_side_and_a_key_goes_back_and_forth(
    player: PlayerPresenter, finished: Path, stream_folder: Path
) -> None:
    for label in ("one", "two", "one", "three", "four"):
        player.compare_with(open_other(stream_folder, label))
    assert [other.label for other in player.others] == ["four", "three", "one"], "the last ones, each once"
    player.choose_mode("side by side")
    settle(player)
    assert 2 * player.picture.box.width <= 256
    assert player.picture.request.names == ("decoded", "other", "other 2", "other 3")
    assert player.exchange()
    assert (player.mode, player.what) == ("single", OTHER)
    assert player.exchange()
    assert player.what == "decoded"
    player.compare_with(None)
    player.look_through("cam4")
    assert player.exchange()
    assert player.what == "footage"
    assert player.exchange()
    assert player.what == "decoded"


def test_curves_of_both_are_on_one_axis(player: PlayerPresenter, finished: Path, stream_folder: Path) -> None:
    player.compare_with(open_other(finished / "take"))
    measured = player.other.series("psnr_decoded")
    assert len(measured) == 5
    assert None not in measured
    player.compare_with(open_other(stream_folder))
    other = player.other
    assert other.series("psnr_decoded") == [None] * 5, "a stream has no evaluation"
    sizes = other.series("bytes")
    files = sum(path.stat().st_size for path in stream_folder.rglob("*") if "manifest" not in path.name)
    assert 0 < 8 * sizes[0] < files
    psnr, size = plots_of({"psnr_decoded": [30.0] * 5, "bytes": [1000.0] * 5}, other={"bytes": [4000.0] * 5})
    assert size.range[1] > 4.0, "the axis covers both"
    assert psnr.range[0] < 30 < psnr.range[1]


def test_bakes_are_kept_on_a_thread(take_copy: Path) -> None:
    take, bakes = Take.open(take_copy), Bakes()

    changes: list[str] = []
    bakes.changed.connect(lambda: changes.append(bakes.message))

    def done() -> str:
        wait_in_loop("the change", lambda: changes)
        changes.clear()
        bakes.look(take)
        return bakes.message

    bakes.keep(take, "fine")
    assert "'fine'" in done()
    (row,) = bakes.rows
    assert (row.name, row.is_stream, bakes.is_kept) == ("fine", True, True)
    assert "dB" in bake_words(row)
    assert "other settings" not in bake_words(row)
    set_settings(take.config, {"capture.audio": "a.wav"})
    bakes.look(take)
    assert "other settings" in bake_words(bakes.rows[0])
    bakes.keep(take, "a/b")
    assert "cannot be the name" in done()
    assert bakes.failed
    assert bakes.close()
