"""Publishing a stream, with the page that plays it if wanted."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from pipelines.share.page import PageText
from studio.progress import ProgressFn, no_progress

if TYPE_CHECKING:
    from studio.stream.publish import Published


def publish(
    source: str | os.PathLike[str],
    target: Path | str,
    text: PageText | None = None,
    *,
    page: bool = False,
    progress: ProgressFn = no_progress,
) -> Published:
    """Copy a stream to a folder or an object store: what is missing there, the manifest last.

    Players see the old stream or the new one, never a mixture. Files that the new manifest does not need stay.

    Example:
        v3studio.publish("my-take", "s3://bucket/my-take", page=True)

    Args:
        source: folder of a take or a stream, one .v3s file, or a URL.
        target: folder, or an address in an object store, such as s3://bucket/folder, which needs s3fs.
        text: of the page; what is None is taken from the stream.
        page: also put index.html and the player there.
        progress: called with (files done, files).

    Raises:
        StudioError: a damaged stream, `share.no_player`, or a target that cannot be written (`publish.failed`,
            `storage.*`).
    """
    from pipelines.share.player_files import read_player
    from pipelines.share.stream_to_share import stream_to_share
    from studio.stream.manifest import MANIFEST_NAME
    from studio.stream.publish import publish as copy

    with stream_to_share(os.fspath(source)) as stream:
        beside: dict[str, bytes] = {}
        if page:
            beside = stream.page_files(stream.text(text or PageText()), read_player(), MANIFEST_NAME)
        return copy(stream.reader, str(target), progress, beside)
