from pathlib import Path

from tests.support.players import settle
from v3studio.gui.drawing.compare import Mode, What
from v3studio.gui.models.playback.other_source import open_other
from v3studio.gui.models.playback.player import PlayerPresenter
from v3studio.gui.models.playback.timeline_plots import plots_of


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
    assert (player.mode, player.what) == (Mode.SINGLE, What.OTHER)
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
