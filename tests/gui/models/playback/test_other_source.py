from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import pytest

from tests.support.players import settle
from v3studio.gui.actions.output import OutputActions
from v3studio.gui.drawing.compare import Mode, What
from v3studio.gui.figures import QualityFigures
from v3studio.gui.models.playback.other_source import open_other
from v3studio.gui.models.playback.player import PlayerPresenter
from v3studio.gui.models.playback.timeline_plots import plots_of
from v3studio.gui.models.take.exports import ExportRequest
from v3studio.gui.models.take.workspace import Workspace
from v3studio.pipelines.takes.take import Take


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


def test_the_figures_and_the_export_are_those_of_what_is_on_the_screen(
    player: PlayerPresenter, finished: Path, workspace: Workspace, monkeypatch: pytest.MonkeyPatch
) -> None:
    player.compare_with(open_other(finished / "take", "older"))
    views: Any = SimpleNamespace(shows_player=True)
    timeline: Any = SimpleNamespace()
    workspace.take = Take.open(finished / "take")
    quality = QualityFigures(player, workspace, views, timeline)
    dialogs, exports = MagicMock(em=16), MagicMock()
    outputs = OutputActions(player, workspace, MagicMock(), exports, dialogs, MagicMock())
    asked: list[ExportRequest] = []
    monkeypatch.setattr("v3studio.gui.actions.output.Form", lambda _, request: asked.append(request) or MagicMock())
    for choose, of in ((lambda: player.choose("decoded"), ""), (player.exchange, "older"), (player.exchange, "")):
        choose()
        player.choose_mode(Mode.SINGLE)
        quality.update()
        assert quality.evaluation.of == of
        assert quality.evaluation.frames
        outputs.export()
        assert of in asked[-1].title
        assert (player.shown_other is not None) == bool(of)
    assert player.other.exported == (finished / "take", "decoded")
