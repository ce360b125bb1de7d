"""`v3studio publish`: copies a stream to a folder or an object store, the manifest last."""

import argparse
from dataclasses import asdict
from pathlib import Path
from typing import Any

from pipelines.commands.common.arguments import add_command
from pipelines.commands.common.working import working
from pipelines.commands.share import add_page_options, page_text
from studio.counts import counted


def register(commands: Any) -> None:
    more = (
        "Files that are there already are not copied again. The manifest is replaced last, so that players see the old "
        "stream or the new one. --page adds a page that plays it."
    )
    text = "copy a stream to a web folder or an object store"
    command = add_command(commands, "publish", text, _publish, more)
    command.add_argument("source", metavar="SOURCE", help="folder of a take or a stream, one .v3s file, or a URL")
    command.add_argument(
        "target", metavar="TARGET", help="folder, or an address such as s3://bucket/folder (needs s3fs)"
    )
    command.add_argument(
        "--page", action="store_true", help="also put index.html and the browser player there, with the options below"
    )
    add_page_options(command)


def _publish(arguments: argparse.Namespace) -> int:
    text = page_text(arguments)
    from pipelines.share.page import PAGE_NAME
    from pipelines.share.publishing import publish
    from studio.storage import is_address

    with working("publish", arguments) as progress:
        done = publish(arguments.source, arguments.target, text, page=arguments.page, progress=progress)
    path = arguments.target if is_address(arguments.target) else str(Path(arguments.target).absolute())
    arguments.result = {"path": path, **asdict(done)}
    if not arguments.json:
        copied = f"{counted(done.copied, 'file')} copied ({done.bytes:,} bytes)"
        print(f"{arguments.target}: {copied}, {done.present} there already")
        if arguments.page:
            print(f"{PAGE_NAME} there plays it.")
        else:
            print("This is the stream alone; --page adds a page that plays it.")
    return 0
