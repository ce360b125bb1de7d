"""Resolves a user's argument: the folder of a stream, the folder of a take, or a URL."""

from __future__ import annotations

from pathlib import Path

from pipelines.takes.take import Take
from studio.errors import StudioError


def stream_place(text: str) -> Path | str:
    """The folder, one-file stream or URL of a stream; for a take, the folder of its stream.

    Raises:
        StudioError: no such folder (`stream.not_found`), or the take has no stream yet (`take.no_stream`).
    """
    if "://" in text:
        return text
    folder = Path(text).expanduser()
    if folder.name in ("manifest.json", "take.json") and folder.is_file():
        folder = folder.parent
    if folder.is_file():
        return folder
    if not (folder / "take.json").is_file():
        if not folder.is_dir():
            raise StudioError(
                "stream.not_found", "no such folder", file=text, fix="Specify the folder of a stream or of a take."
            )
        return folder
    stream = Take.open(folder).stream
    if not stream.is_dir():
        raise StudioError(
            "take.no_stream",
            "this take has no stream yet",
            file=text,
            fix="Run `v3studio run` or `v3studio bake`.",
            stage="bake",
        )
    return stream
