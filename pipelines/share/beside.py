"""The files that play a stream from a web server: page, player and poster, all named relative to the page."""

from __future__ import annotations

from pipelines.share.page import first_files, player_page, preview_tags
from pipelines.share.player_files import PlayerFiles, hashed_name
from pipelines.share.poster import draw_poster
from pipelines.share.results import PageText
from pipelines.share.stream_files import StreamToShare

PAGE_NAME = "index.html"


def page_files(stream: StreamToShare, words: PageText, player: PlayerFiles, manifest: str) -> dict[str, bytes]:
    """Contents by name: the poster first, the page last. All but the page are named by their content.

    Args:
        stream: to draw the poster from.
        words: title and so on, completed (`StreamToShare.text`).
        player: `read_player()`.
        manifest: address of the stream's manifest relative to the page.

    Raises:
        StudioError: the stream's first group is damaged, or the player is of another version.
    """
    poster = draw_poster(stream)
    name = hashed_name("poster.jpg", poster.data)
    script = f'<script type="module" src="{player.script_name}"></script>'
    first = first_files(stream.manifest_bytes)
    tags = preview_tags(words, name, poster.size)
    page = player_page(player.page, script, manifest, words, name, tags, first=first)
    return {name: poster.data, **player.hashed, PAGE_NAME: page.encode()}
