"""What a user names on the command line: a stream's folder, a take's folder, or an address."""

from __future__ import annotations

from pathlib import Path

from pipelines.takes.take import Take
from studio.errors import StudioError


def stream_place(text: str) -> Path | str:
    """The folder or http(s) address of the stream that `text` names; of a take it is the take's stream.

    Raises:
        StudioError: the take has no stream yet, or there is no such folder.
    """
    if "://" in text:
        return text
    folder = Path(text).expanduser()
    if folder.name in ("manifest.json", "take.json") and folder.is_file():
        folder = folder.parent
    if not (folder / "take.json").is_file():
        if not folder.is_dir():
            raise StudioError(f"{text}: there is no such folder; give the folder of a stream or of a take.")
        return folder
    stream = Take.open(folder).stream
    if not stream.is_dir():
        raise StudioError(f"{text}: this take has no stream yet; run `v3studio run` or `v3studio bake`.")
    return stream
