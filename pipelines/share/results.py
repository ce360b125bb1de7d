"""What is written on a shared page, and what sharing has written."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Literal

from studio.json_types import JsonObject


@dataclass(frozen=True)
class PageText:
    """Text of a shared page, plain text without markup.

    Attributes:
        title: None for the stream's own, else the take's name.
        credits: whom to name, for example "Jane Doe, Studio X"; None for the stream's own, "" for none.
        license: of the footage, for example "CC BY 4.0"; None for the stream's own, "" for none.
        address: where the page will be, for example "https://example.org/walk/". Link previews need it: their
            pictures are only found by whole addresses. None if it is not known.
        description: what is to be seen, for screen readers and link previews; None for the stream's own, "" for none.
        intro: a camera path from `read_intro`, with which the page begins; None for none.
    """

    title: str | None = None
    credits: str | None = None
    license: str | None = None
    address: str | None = None
    description: str | None = None
    intro: str | None = None

    def encodable(self) -> PageText:
        """The same with "?" for lone surrogates, which UTF-8 cannot hold: JSON escapes and file names can."""
        given = {name: value for name, value in vars(self).items() if value is not None}
        return replace(self, **{name: value.encode("utf-8", "replace").decode() for name, value in given.items()})


@dataclass(frozen=True)
class ShareSize:
    """What sharing a stream would take.

    Attributes:
        stream_bytes: of all files of the stream.
        player_bytes: of the player's files.
        single_file_bytes: of the single HTML file: base64 makes everything a third larger.
        single_file_possible: whether the stream is small enough for one.
        frames, seconds: of the stream.
    """

    stream_bytes: int
    player_bytes: int
    single_file_bytes: int
    single_file_possible: bool
    frames: int
    seconds: float


@dataclass(frozen=True)
class Shared:
    """What was written.

    Attributes:
        form: a folder or a single HTML file.
        path: the folder or the file.
        title: of the page.
        files: how many were written.
        total_bytes: of all of them.
        stream_bytes, player_bytes, poster_bytes: parts of it; in a single file before they became base64.
    """

    form: Literal["folder", "single-file"]
    path: Path
    title: str
    files: int
    total_bytes: int
    stream_bytes: int
    player_bytes: int
    poster_bytes: int

    def to_dict(self) -> JsonObject:
        """JSON-ready."""
        return {**asdict(self), "path": str(self.path)}
