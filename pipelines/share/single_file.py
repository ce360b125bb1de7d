"""One HTML file that holds the player, the stream and the poster: opens from the disk, without a web server."""

from __future__ import annotations

import os
import re
from base64 import b64encode
from collections.abc import Iterator
from html import escape
from pathlib import Path

from pipelines.share.page import GENERATOR, player_page, preview_tags
from pipelines.share.player_files import read_player
from pipelines.share.poster import draw_poster
from pipelines.share.results import PageText, Shared
from pipelines.share.stream_files import StreamToShare, stream_to_share
from pipelines.takes.atomic_files import atomic_path, disk_errors
from studio.atomic_files import remove_leftovers
from studio.errors import StudioError
from studio.progress import ProgressFn, no_progress
from studio.stream.manifest import MANIFEST_NAME

MAX_SINGLE_FILE_BYTES = 32_000_000
"""Largest stream that is put into one file: a browser holds the whole page in memory several times."""

_MARK = f'<meta name="generator" content="{GENERATOR}'.encode()
_HOLDER = "v3-stream"  # id of the element that holds the stream's files
_ENDS_SCRIPT = re.compile(r"<(?=/script|!--)", re.IGNORECASE)


def share_single_file(
    source: str, out: Path, text: PageText | None = None, progress: ProgressFn = no_progress
) -> Shared:
    """Write one HTML file. An earlier one in its place is replaced.

    Args:
        source: folder of a take or a stream, or a URL.
        out: file to write, ending in .html; must not exist, or be an earlier share.
        text: of the page; what is None is taken from the stream.
        progress: files done and in total.

    Raises:
        StudioError: `share.not_html`, `share.out_exists`, `share.too_large` (a stream of more than
            `MAX_SINGLE_FILE_BYTES`), `share.no_player`, no stream in `source`, a damaged stream, or a disk that is full
            or not writable.
    """
    player = read_player()
    out = out.expanduser().absolute()
    _check_replaceable(out)
    with stream_to_share(source) as stream, disk_errors(out):
        if stream.total_bytes > MAX_SINGLE_FILE_BYTES:
            raise StudioError(
                "share.too_large",
                f"the stream has {stream.total_bytes / 1e6:.1f} MB; a single file holds at most "
                f"{MAX_SINGLE_FILE_BYTES / 1e6:.0f} MB",
                file=source,
                value=stream.total_bytes,
                fix="Share it as a folder, or bake fewer frames or a higher QP.",
                expected=MAX_SINGLE_FILE_BYTES,
            )
        words = stream.text(text or PageText())
        progress(0, len(stream.files) + 1)
        poster = draw_poster(stream)
        script = "\n".join(
            [
                f'<div id="{_HOLDER}" hidden>',
                *_embedded(stream, progress),
                "</div>",
                f'<script type="text/plain" id="third-party-licenses">{_in_script(player.licenses.decode())}</script>',
                f'<script type="module">{_in_script(player.script.decode())}</script>',
            ]
        )
        page = player_page(
            player.page,
            script,
            f"#{_HOLDER}",
            words,
            f"data:image/jpeg;base64,{b64encode(poster.data).decode()}",
            preview_tags(words, None, poster.size),
        ).encode()
        remove_leftovers(out.parent, out)
        with atomic_path(out) as temporary:
            temporary.write_bytes(page)
        progress(len(stream.files) + 1, len(stream.files) + 1)
        return Shared(
            form="single-file",
            path=out,
            title=words.title or "",
            files=1,
            total_bytes=len(page),
            stream_bytes=stream.total_bytes,
            player_bytes=player.size,
            poster_bytes=len(poster.data),
        )


def _embedded(stream: StreamToShare, progress: ProgressFn) -> Iterator[str]:
    """The stream's files as elements that no browser runs or loads."""
    yield _element(MANIFEST_NAME, stream.manifest_bytes)
    files = stream.files
    for done, file in enumerate(files, start=1):
        progress(done, len(files) + 1)
        yield _element(file.path, stream.read(file))


def _element(path: str, data: bytes) -> str:
    kind = "application/octet-stream;base64"
    return f'<script type="{kind}" data-v3-file="{escape(path)}">{b64encode(data).decode()}</script>'


def _in_script(text: str) -> str:
    """JavaScript in which nothing ends or changes the script element around it. What is escaped can only stand in
    string literals and regular expressions of a minified script, where `\\x3C` means the same."""
    return _ENDS_SCRIPT.sub(lambda _: r"\x3C", text)


def _check_replaceable(out: Path) -> None:
    """Raises StudioError (`share.not_html`, `share.out_exists`) unless `out` can be written."""
    if out.suffix.lower() not in (".html", ".htm"):
        raise StudioError(
            "share.not_html", "a single file must end in .html", file=out, fix=f"Example: {out.name or 'take'}.html."
        )
    if not os.path.lexists(out):
        return
    if out.is_file():
        with out.open("rb") as file:
            if _MARK in file.read(4096):
                return
    raise StudioError(
        "share.out_exists",
        "exists and is not an earlier share",
        file=out,
        fix="Choose another name, or delete it.",
    )
