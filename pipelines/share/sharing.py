"""`share`: the player with a stream as a folder for any web server, or as one HTML file that opens from the disk.

Nothing is loaded from elsewhere. `publish`: a stream where it is served, with the page that plays it if wanted.
"""

import os
import re
from base64 import b64encode
from collections.abc import Iterator
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Literal

from v3studio.pipelines.outputs import check_output
from v3studio.pipelines.share.cast import is_cast
from v3studio.pipelines.share.page import GENERATOR, PageText, player_page, preview_tags
from v3studio.pipelines.share.player_files import PlayerFiles, read_player
from v3studio.pipelines.share.shared_folder import RECORD_NAME, is_shared_folder, shared_folder
from v3studio.pipelines.share.stream_to_share import StreamToShare, stream_to_share
from v3studio.pipelines.takes.files.disk_errors import disk_errors
from v3studio.studio.atomic_files import atomic_path, remove_leftovers
from v3studio.studio.errors import StudioError
from v3studio.studio.progress import ProgressFn, no_progress
from v3studio.studio.stream.manifest import MANIFEST_NAME
from v3studio.studio.stream.publish import Published
from v3studio.studio.stream.publish import publish as publish_stream

MAX_SINGLE_FILE_BYTES = 32_000_000
"""Largest stream that is put into one file: a browser holds the whole page in memory several times."""

SINGLE_FILE_ENDINGS = (".html", ".htm")  # of names that are taken for those of single files

_MARK = f'<meta name="generator" content="{GENERATOR}'.encode()
_HOLDER = "v3-stream"  # id of the element that holds the stream's files
_ENDS_SCRIPT = re.compile(r"<(?=/script|!--)", re.IGNORECASE)


@dataclass(frozen=True)
class ShareSize:
    """Sizes of a share before it is written, without its images (some 100 to 300 KB): bytes of all files; bytes of the
    single HTML file, which base64 makes a third larger, and whether the stream is small enough for one."""

    stream_bytes: int
    player_bytes: int
    single_file_bytes: int
    single_file_possible: bool
    frames: int
    seconds: float


@dataclass(frozen=True)
class Shared:
    """A share that has been written.

    Attributes:
        form: a folder or a single HTML file.
        path: the folder or the file.
        title: of the page.
        files: how many were written.
        total_bytes: of all of them.
        stream_bytes, player_bytes, poster_bytes: parts of it; in a single file before they became base64. The poster's
            include the image of link previews.
    """

    form: Literal["folder", "single-file"]
    path: Path
    title: str
    files: int
    total_bytes: int
    stream_bytes: int
    player_bytes: int
    poster_bytes: int


def share_size(source: str) -> ShareSize:
    """Sizes of a take's or a stream's share. Raises StudioError: no stream there, or the player is not built."""
    player = read_player().size
    with stream_to_share(source) as stream:
        total = stream.total_bytes
        return ShareSize(
            stream_bytes=total,
            player_bytes=player,
            single_file_bytes=player + (total + 2) // 3 * 4,
            single_file_possible=total <= MAX_SINGLE_FILE_BYTES,
            frames=stream.reader.manifest.frame_count,
            seconds=stream.reader.manifest.duration,
        )


def share(
    source: str | os.PathLike[str],
    out: Path | str,
    text: PageText | None = None,
    *,
    overwrite: bool = False,
    progress: ProgressFn = no_progress,
) -> Shared:
    """Write the player with a stream: a folder for any web server, or one HTML file that opens from the disk.

    All names in the folder are relative, so that it works below any path.

    Example:
        >>> shared = v3.share("my-take", "site", v3.PageText(title="Walk", license="CC BY 4.0"))
        >>> shared.form, (shared.path / "index.html").is_file()
        ('folder', True)

    Args:
        source: folder of a take or a stream, or a URL; or the JSON document of a cast (`pipelines.share.cast`).
        out: folder to write, or HTML file, whose name ends in .html, for streams of at most 32,000,000 bytes.
        text: of the page; what is None is taken from the stream.
        overwrite: replace an earlier share, when the new one is complete; anything else is never replaced.
        progress: called with (files done, files).

    Raises:
        StudioError: `output.exists`, `output.not_ours`, `share.too_large`, `share.no_player`, no stream in `source`,
            a damaged stream, or a disk that is full or not writable.
    """
    source = os.fspath(source)
    out = Path(out).expanduser().absolute()
    single_file = out.suffix.lower() in SINGLE_FILE_ENDINGS
    check_output(out, overwrite, _is_shared_file if single_file else is_shared_folder)
    if is_cast(source):
        if single_file:
            fix = "Name a folder with --out."
            raise StudioError("share.bad_cast", "a cast is shared as a folder", file=out, fix=fix)
        from v3studio.pipelines.share.cast_folder import write_cast

        title, written = write_cast(Path(source).expanduser(), out, text or PageText(), progress)
        return _shared_folder(out, title, written)
    player = read_player()
    with stream_to_share(source) as stream, disk_errors(out):
        if single_file and stream.total_bytes > MAX_SINGLE_FILE_BYTES:
            raise StudioError(
                "share.too_large",
                f"the stream has {stream.total_bytes / 1e6:.1f} MB; a single file holds at most "
                f"{MAX_SINGLE_FILE_BYTES / 1e6:.0f} MB",
                file=source,
                value=stream.total_bytes,
                fix="Share it as a folder, or bake fewer frames or a higher QP.",
                expected=MAX_SINGLE_FILE_BYTES,
            )
        write = _write_file if single_file else _write_folder
        return write(stream, out, stream.text(text or PageText()), player, progress)


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
    with stream_to_share(os.fspath(source)) as stream:
        beside: dict[str, bytes] = {}
        if page:
            beside = stream.page_files(stream.text(text or PageText()), read_player(), MANIFEST_NAME)
        return publish_stream(stream.reader, str(target), progress, beside)


# A folder


def _write_folder(
    stream: StreamToShare, out: Path, text: PageText, player: PlayerFiles, progress: ProgressFn
) -> Shared:
    """index.html, the player and its images, the stream below `stream/`, and a record of them."""
    files = stream.reader.files
    with shared_folder(out, text.title) as folder:
        progress(0, len(files) + 1)
        beside = stream.page_files(text, player, f"stream/{MANIFEST_NAME}")
        folder.write_stream("stream", stream.reader, lambda done, total: progress(done + 1, total + 1))
        for name, data in beside.items():
            folder.write(name, data)
        progress(len(files) + 1, len(files) + 1)
    return _shared_folder(out, text.title or "", folder.written)


def _shared_folder(out: Path, title: str, written: dict[str, int]) -> Shared:
    """`written`: bytes by path; streams are in folders of their own, beside the page and its files."""
    beside = {name: size for name, size in written.items() if "/" not in name}
    total = sum(written.values())
    images = sum(size for name, size in beside.items() if name.endswith(".jpg"))
    player = sum(beside.values()) - images - written[RECORD_NAME]
    return Shared("folder", out, title, len(written), total, total - sum(beside.values()), player, images)


# One HTML file


def _write_file(stream: StreamToShare, out: Path, text: PageText, player: PlayerFiles, progress: ProgressFn) -> Shared:
    """The player, the stream and the poster in one page."""
    steps = len(stream.reader.files) + 1
    progress(0, steps)
    poster = stream.poster()
    script = "\n".join(
        [
            f'<div id="{_HOLDER}" hidden>',
            *_embedded(stream, progress),
            "</div>",
            f'<script type="module">{_in_script(player.script.decode())}</script>',
        ]
    )
    image = f"data:image/jpeg;base64,{b64encode(poster).decode()}"
    tags = preview_tags(text)
    page = player_page(player.page, script, f"#{_HOLDER}", text, image, tags).encode()
    remove_leftovers(out.parent, out)
    with atomic_path(out) as temporary:
        temporary.write_bytes(page)
    progress(steps, steps)
    return Shared(
        form="single-file",
        path=out,
        title=text.title or "",
        files=1,
        total_bytes=len(page),
        stream_bytes=stream.total_bytes,
        player_bytes=player.size,
        poster_bytes=len(poster),
    )


def _embedded(stream: StreamToShare, progress: ProgressFn) -> Iterator[str]:
    """The stream's files as elements that no browser runs or loads."""

    def element(path: str, data: bytes) -> str:
        kind = "application/octet-stream;base64"
        return f'<script type="{kind}" data-v3-file="{escape(path)}">{b64encode(data).decode()}</script>'

    yield element(MANIFEST_NAME, stream.reader.manifest_bytes)
    files = stream.reader.files
    for done, file in enumerate(files, start=1):
        progress(done, len(files) + 1)
        yield element(file.path, stream.reader.checked(file))


def _in_script(text: str) -> str:
    """JavaScript in which nothing ends or changes the script element around it. What is escaped can only stand in
    string literals and regular expressions of a minified script, where `\\x3C` means the same."""
    return _ENDS_SCRIPT.sub(lambda _: r"\x3C", text)


def _is_shared_file(out: Path) -> bool:
    if not out.is_file():
        return False
    with out.open("rb") as file:
        return _MARK in file.read(4096)
