"""Sharing from a script, as `v3studio share` does from the command line."""

from __future__ import annotations

from pathlib import Path

from pipelines.share.folder import share_folder
from pipelines.share.results import PageText, Shared
from pipelines.share.single_file import share_single_file
from studio.progress import ProgressFn, no_progress


def share(
    source: Path | str,
    out: Path | str,
    text: PageText | None = None,
    *,
    single_file: bool = False,
    progress: ProgressFn = no_progress,
) -> Shared:
    """Write the player with a stream: a folder for any web server, or one HTML file that opens from the disk.

    An earlier share in its place is replaced when the new one is complete; anything else is not.

    Example:
        v3studio.share("my-take", "site", v3studio.PageText(title="Walk", license="CC BY 4.0"))

    Args:
        source: folder of a take or a stream, or a URL.
        out: folder to write, or file ending in .html.
        text: of the page; what is None is taken from the stream.
        single_file: write one file; for streams of at most 32,000,000 bytes.
        progress: called with (files done, files).

    Raises:
        StudioError: `share.out_exists`, `share.not_html`, `share.too_large`, `share.no_player`, no stream in `source`,
            a damaged stream, or a disk that is full or not writable.
    """
    write = share_single_file if single_file else share_folder
    return write(str(source), Path(out), text, progress)
