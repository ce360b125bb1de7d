"""Writes the page of a cast: its streams and static files, the script that shows them, and its images."""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from urllib.parse import quote

from v3studio.pipelines.share.cast import beside, read_cast
from v3studio.pipelines.share.cast_images import cast_images
from v3studio.pipelines.share.page import PAGE_NAME, PageText, cast_page, preview_tags, script_elements
from v3studio.pipelines.share.player_files import hashed_name, player_folder
from v3studio.pipelines.share.shared_folder import SharedFolder, shared_folder
from v3studio.pipelines.share.stream_to_share import stream_to_share
from v3studio.pipelines.takes.files.disk_errors import disk_errors
from v3studio.studio.errors import StudioError
from v3studio.studio.progress import ProgressFn
from v3studio.studio.stream.manifest import MANIFEST_NAME

CAST_NAME = "cast.json"
SCRIPT_NAME = "v3-cast.js"
LICENSES_NAME = "licenses.txt"  # of what the script includes: three.js and Spark

MAX_FILE_BYTES = 1_000_000_000  # of a static file

_GZIP = b"\x1f\x8b"


def write_cast(source: Path, out: Path, text: PageText, progress: ProgressFn) -> tuple[str, dict[str, int]]:
    """Write the page of a cast into a folder; returns its title, and the bytes of each file. Without `text`, title,
    credits and license are the document's and the streams'.

    StudioError: `share.bad_cast` (also for a text that the page has no place for), `share.no_player`, no stream where
    an item names one, or a disk that is full.
    """
    cast = read_cast(source)
    page, script, licenses = _page_files()
    unused = [name for name in ("intro", "view", "marks") if getattr(text, name) is not None]
    if unused:
        fix = f"Leave out {' and '.join('--' + name for name in unused)}."
        raise StudioError("share.bad_cast", f"the page of a cast has no {unused[0]}", file=source, fix=fix)
    text = replace(text, title=text.title or cast.title).plain()
    title = text.title or ""
    placed: dict[str, str] = {}
    streams: list[PageText] = []
    with disk_errors(out), shared_folder(out, title) as folder:
        for number, item in enumerate(cast.items):
            progress(number, len(cast.items))
            for named in (item.stream, item.splats, item.model):
                if named is not None and named not in placed:
                    if named == item.stream:
                        with stream_to_share(beside(named, source)) as stream:
                            folder.write_stream(str(len(placed)), stream.reader)
                            streams.append(stream.text(PageText()))
                        placed[named] = f"{len(placed)}/{MANIFEST_NAME}"
                    else:
                        placed[named] = _add_file(named, source, folder, len(placed))
        document = cast.model_dump(mode="json", exclude_none=True)
        for item_values in document["items"]:
            for kind in ("stream", "splats", "model"):
                if kind in item_values:
                    item_values[kind] = placed[item_values[kind]]
        document.setdefault("ground", None)
        name = hashed_name(SCRIPT_NAME, script)
        folder.write(name, script)
        folder.write(LICENSES_NAME, licenses)
        folder.write(CAST_NAME, json.dumps(document, indent=1).encode())
        poster = preview = None
        made = cast_images(source)
        if made is not None:
            poster, preview = hashed_name("poster.jpg", made[0]), hashed_name("preview.jpg", made[1])
            folder.write(poster, made[0])
            folder.write(preview, made[1])
        tags = preview_tags(replace(text, credits=_credits(text, streams), license=None), preview)
        filled = cast_page(page, script_elements([name]), title, _credits(text, streams), poster, tags)
        folder.write(PAGE_NAME, filled.encode())
        progress(len(cast.items), len(cast.items))
    return title, folder.written


def _page_files() -> tuple[str, bytes, bytes]:
    """Page, script and licenses."""
    try:
        folder = player_folder()
        page, cast = (folder / "index.html").read_text(encoding="utf-8"), folder / "cast"
        return page, (cast / SCRIPT_NAME).read_bytes(), (cast / LICENSES_NAME).read_bytes()
    except OSError as error:
        problem = "the page of a cast is not built"
        raise StudioError("share.no_player", problem, fix="Run `make web-package`.") from error


def _credits(text: PageText, streams: Sequence[PageText]) -> str:
    """Credits and license in one line: those given, or else each of the streams' once."""
    lines = [[stream.credits or "", stream.license or ""] for stream in streams]
    given = [[text.credits or "", text.license or ""]] if text.credits or text.license else lines
    return "; ".join(dict.fromkeys(", ".join(part for part in line if part) for line in given if any(line)))


def _add_file(named: str, source: Path, folder: SharedFolder, number: int) -> str:
    """Copy a static file; its new address."""
    path = Path(beside(named, source))
    try:
        size = path.stat().st_size
        if size > MAX_FILE_BYTES:
            problem = f"has {size:,} bytes; at most {MAX_FILE_BYTES:,} are shared"
            raise StudioError("share.bad_cast", problem, file=path, value=size, fix="Reduce the number of its splats.")
        data = path.read_bytes()
    except OSError as error:
        problem = f"cannot be read: {error.strerror}"
        raise StudioError("share.bad_cast", problem, file=path, fix=f"Correct the path in {source}.") from None
    if path.suffix.lower() == ".spz" and not data.startswith(_GZIP):
        fix = "Export it with --spz-version 3."
        raise StudioError("share.bad_cast", "is no SPZ of version 3 or older, which the page reads", file=path, fix=fix)
    folder.write(f"{number}/{path.name}", data)
    return f"{number}/{quote(path.name)}"
