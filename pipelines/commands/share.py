"""`v3studio share` and `publish`: put a stream, and the page that plays it, where a web server finds them."""

from __future__ import annotations

import argparse
import shlex
from dataclasses import asdict
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from v3studio.pipelines.commands.common.arguments import add_command, add_overwrite, invalid_option
from v3studio.pipelines.commands.common.working import working
from v3studio.pipelines.reports.terminal import say
from v3studio.studio.counts import counted

if TYPE_CHECKING:
    from v3studio.pipelines.share.page import PageText


def register(commands: Any) -> None:
    more = (
        "It is a folder with the browser player and the stream, which any web server can serve, at any path, or one "
        "HTML file that opens from the disk. Nothing is loaded from elsewhere."
    )
    text = "write a web page that plays a stream, for any web server or as one file"
    share = add_command(commands, "share", text, _share, more)
    share.add_argument(
        "source",
        metavar="SOURCE",
        help="folder of a take or a stream, an http(s):// URL, or the .json document of a cast",
    )
    share.add_argument(
        "--out", type=Path, required=True, metavar="PATH", help="folder to write, or .html file (streams up to 32 MB)"
    )
    add_overwrite(share)
    _add_page_options(share)

    more = (
        "Files that are there already are not copied again. The manifest is replaced last, so that players see the old "
        "stream or the new one. --page adds a page that plays it."
    )
    text = "copy a stream to a web folder or an object store"
    publish = add_command(commands, "publish", text, _publish, more)
    publish.add_argument("source", metavar="SOURCE", help="folder of a take or a stream, one .v3s file, or a URL")
    publish.add_argument(
        "target", metavar="TARGET", help="folder, or an address such as s3://bucket/folder (needs s3fs)"
    )
    publish.add_argument(
        "--page", action="store_true", help="also put index.html and the browser player there, with the options below"
    )
    _add_page_options(publish)


def _add_page_options(share: argparse.ArgumentParser) -> None:
    add_first_options(share)
    share.add_argument("--credits", metavar="TEXT", help='credits line; example: "Jane Doe, Studio X"')
    share.add_argument("--license", metavar="TEXT", help='license of the footage; example: "CC BY 4.0"')
    share.add_argument("--description", metavar="TEXT", help="description for screen readers and link previews")
    share.add_argument(
        "--marks",
        action="store_true",
        help="show the take's marks that have a note: anyone with the page reads them",
    )
    share.add_argument(
        "--address", metavar="URL", help="future address of the page, which link previews need to show the poster"
    )


def add_first_options(command: argparse.ArgumentParser) -> None:
    """Add the options of `share`, `publish` and `serve` for what a page begins with; `page_text` reads them."""
    command.add_argument("--title", metavar="TEXT", help="title of the page (default: the stream's, else its name)")
    command.add_argument(
        "--intro",
        type=Path,
        metavar="FILE",
        help="camera path that the page plays until the viewer takes over: a file as for `v3studio export --path`",
    )
    command.add_argument(
        "--view",
        metavar="VIEW",
        help="first view of the page, as in links to the player: azimuth and elevation in degrees, optionally distance "
        "and target; example: --view=-30,10 (default: from the first camera's direction, at eye level, with everybody "
        "in the image)",
    )


def page_text(arguments: argparse.Namespace) -> PageText:
    """The text of a page from the options, of which not all commands have all."""
    from v3studio.pipelines.share.page import PageText, read_intro, read_public_marks, read_view

    given = {name: getattr(arguments, name, None) for name in ("title", "credits", "license", "address", "description")}
    if given["address"] is not None:
        parts = urlsplit(given["address"])
        if parts.scheme not in ("http", "https") or not parts.netloc or parts.query or parts.fragment:
            problem = f"--address '{given['address']}' is not the http(s):// address of a folder"
            raise invalid_option("--address", problem, "Example: https://example.org/walk/.", given["address"])
    intro = None if arguments.intro is None else read_intro(arguments.intro, arguments.source)
    view = None if arguments.view is None else read_view(arguments.view)
    marks = read_public_marks(arguments.source) if getattr(arguments, "marks", False) else None
    return PageText(**given, intro=intro, view=view, marks=marks)


def _share(arguments: argparse.Namespace) -> None:
    text = page_text(arguments)
    from v3studio.pipelines.share.sharing import share

    with working("share", arguments) as progress:
        shared = share(arguments.source, arguments.out, text, overwrite=arguments.overwrite, progress=progress)
    arguments.result = {**asdict(shared), "path": str(shared.path)}
    if arguments.json:
        return
    parts = f"stream {shared.stream_bytes:,}, player {shared.player_bytes:,}, poster {shared.poster_bytes:,}"
    say(f"{arguments.out}: {counted(shared.files, 'file')}, {shared.total_bytes:,} bytes ({parts})")
    if shared.form == "single-file":
        say("Open it in a browser.")
    else:
        folder = shlex.quote(str(arguments.out))
        say(f"To look at it: python3 -m http.server --directory {folder}    then open http://localhost:8000/")
        say("Phones decode fastest from https:// addresses.")
        if arguments.address is not None:
            say(f"To embed it: {iframe(arguments.address)}")


def _publish(arguments: argparse.Namespace) -> None:
    text = page_text(arguments)
    from v3studio.pipelines.share.page import PAGE_NAME
    from v3studio.pipelines.share.sharing import publish
    from v3studio.studio.storage import is_address

    with working("publish", arguments) as progress:
        done = publish(arguments.source, arguments.target, text, page=arguments.page, progress=progress)
    path = arguments.target if is_address(arguments.target) else str(Path(arguments.target).absolute())
    arguments.result = {"path": path, **asdict(done)}
    if not arguments.json:
        copied = f"{counted(done.copied, 'file')} copied ({done.bytes:,} bytes)"
        say(f"{arguments.target}: {copied}, {done.present} there already")
        alone = "This is the stream alone; --page adds a page that plays it."
        say(f"{PAGE_NAME} there plays it." if arguments.page else alone)


def iframe(address: str) -> str:
    """HTML that embeds a shared page in another page."""
    allowed = "fullscreen; clipboard-write; gamepad; xr-spatial-tracking"
    return f'<iframe src="{escape(address)}" allow="{allowed}" width="640" height="480" style="border: 0"></iframe>'
