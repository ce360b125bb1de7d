from pathlib import Path
from typing import Any

from starlette.applications import Starlette
from starlette.routing import Mount
from starlette.staticfiles import StaticFiles

from tests.support.players import settle
from tests.support.web_servers import running
from v3studio.gui.models.playback.player import PlayerPresenter
from v3studio.gui.models.playback.sources import load
from v3studio.gui.widgets.timeline import TimelinePanel


def test_a_stream_on_the_web_is_not_downloaded_for_the_strip(stream_folder: Path) -> None:
    player = PlayerPresenter()
    asked: list[str] = []

    class Files(StaticFiles):
        async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
            asked.append(scope["path"])
            await super().__call__(scope, receive, send)

    panel = TimelinePanel(player, 16.0, lambda: None)
    with running(Starlette(routes=[Mount("/", Files(directory=stream_folder))])) as port:
        player.adopt(*load(f"http://127.0.0.1:{port}"))
        for frame in (0, 11):  # of both groups
            player.transport.seek(frame)
            settle(player)
        before = len(asked)
        assert before
        assert panel.filmstrip.pictures(player, [0, 4], (40, 50)) == {}
        assert panel.plots_view.strip == 0, "no room for it either"
        assert len(asked) == before
    player.adopt(*load(stream_folder))
    assert panel.plots_view.strip > 0
    assert player.close()
