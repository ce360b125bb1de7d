"""`v3studio serve`: serves streams and the browser player over HTTP or HTTPS."""

from __future__ import annotations

import argparse
import contextlib
import logging
import os
import select
import sys
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from v3studio.pipelines.commands.common.arguments import add_command, invalid_option
from v3studio.pipelines.commands.share import add_first_options, page_text
from v3studio.pipelines.events import Serving as ServingEvent
from v3studio.pipelines.events.cancellation import EXIT_CANCELLED
from v3studio.pipelines.reports.terminal import say
from v3studio.studio.errors import StudioError

if TYPE_CHECKING:
    import uvicorn

    from v3studio.pipelines.share.serving import Serving


def register(commands: Any) -> None:
    more = (
        "Open the printed address in a browser to play them. Only files of streams are served, no other files of a "
        "take. A take that is being trained with --live is served from its first group on. Press Ctrl-C to stop."
    )
    serve = add_command(commands, "serve", "serve streams and the browser player", _serve, more)
    serve.add_argument("source", metavar="DIR", help="folder of a stream or a take, or a folder of several")
    serve.add_argument(
        "--host", default="127.0.0.1", help="address to bind to; 0.0.0.0 for other machines (default: %(default)s)"
    )
    serve.add_argument("--port", type=int, default=8000, help="port to bind to; 0: any free port (default: 8000)")
    serve.add_argument(
        "--https",
        action="store_true",
        help="encrypt; without --certificate, a certificate is made for this run. Browsers warn about it: compare its "
        "fingerprint with the printed one",
    )
    serve.add_argument("--certificate", type=Path, metavar="FILE", help="certificate in PEM format; implies --https")
    serve.add_argument("--key", type=Path, metavar="FILE", help="its private key, if it is not in the same file")
    add_first_options(serve)
    serve.add_argument(
        "--review",
        action="store_true",
        help="also serve a review of the take at a secret link, which is printed: quality and size per frame, "
        "footage of held-out cameras, and marks that anyone with the link may change",
    )
    serve.add_argument(
        "--token",
        action=argparse.BooleanOptionalAction,
        help="add a secret part to the printed link, without which nothing is served (default: if other machines can "
        "reach the server)",
    )
    serve.add_argument(
        "--allow-host",
        action="append",
        default=[],
        metavar="NAME",
        help="another name of this machine in links, such as example.org; may be repeated",
    )
    serve.add_argument(
        "--allow-origin",
        action="append",
        default=[],
        metavar="ORIGIN",
        help="let pages of this origin, such as https://example.org, or of all ('*') play the stream and show its page "
        "in a frame; may be repeated",
    )
    serve.add_argument(
        "--end-with-stdin",
        action="store_true",
        help="stop when standard input closes, so that the server never outlives the program that started it",
    )


def _serve(arguments: argparse.Namespace) -> int:
    from v3studio.pipelines.share.certificates import load_certificate
    from v3studio.pipelines.share.player_files import read_player
    from v3studio.pipelines.share.served import wait_for_first_group
    from v3studio.pipelines.share.serving import Serving

    wait_for_first_group(arguments.source, _stdin_closes if arguments.end_with_stdin else _keep_waiting)
    text = page_text(arguments)
    player = certificate = None
    try:
        player = read_player()
    except StudioError as error:
        say(f"warning: {error} Streams are served without it.", error=True)
    if arguments.certificate is not None:
        certificate = load_certificate(arguments.certificate, arguments.key)
    elif arguments.key is not None:
        fix = "Specify the certificate that belongs to the key."
        raise invalid_option("--key", "--key needs --certificate", fix, arguments.key)
    serving = Serving(
        arguments.source,
        arguments.host,
        arguments.port,
        player,
        https=arguments.https,
        certificate=certificate,
        token=arguments.token,
        review=arguments.review,
        allow_hosts=arguments.allow_host,
        allow_origins=arguments.allow_origin,
        text=text,
    )
    server = serving.server
    with contextlib.closing(serving):
        if arguments.json:
            arguments.emit(_event(serving))
        else:
            _print(serving, player is not None)
        _bound_logs(server)
        if arguments.end_with_stdin:
            threading.Thread(target=_end_with_stdin, args=(server,), name="v3studio stdin", daemon=True).start()
        # uvicorn raises its signal again on exit, but not always before `run` returns
        with contextlib.suppress(KeyboardInterrupt):
            serving.run()
        return EXIT_CANCELLED if server.should_exit else 0


def _bound_logs(server: uvicorn.Server) -> None:
    """Let a flood of messages print only some of them, and connections that Ctrl-C closed none."""
    from v3studio.pipelines.share.server import BoundedLog

    bounded = BoundedLog()
    for name in ("uvicorn.error", "asyncio"):
        logging.getLogger(name).addFilter(bounded)
    logging.getLogger("uvicorn.error").addFilter(lambda record: not server.should_exit)


def _end_with_stdin(server: uvicorn.Server) -> None:
    while not _stdin_closes():
        pass
    server.should_exit = True


def _stdin_closes(seconds: float | None = None) -> bool:
    """Wait for standard input, None: as long as it takes, and return whether it has closed. The kernel closes the other
    end of the pipe when the process that holds it has ended for whatever reason."""
    try:
        return bool(select.select([0], [], [], seconds)[0]) and not os.read(0, 65536)
    except OSError:
        return True


def _keep_waiting(seconds: float) -> bool:
    time.sleep(seconds)
    return False


def _print(serving: Serving, player: bool) -> None:
    """Print the addresses, and what phones need; in a terminal, a QR code too."""
    certificate = serving.certificate
    lines = [f"Serving {folder} at {address}" for address, folder in serving.streams.items()]
    browser = "open the address in a browser, or run " if player else ""
    lines.append(f"To play: {browser}v3studio play {serving.address}    To stop: Ctrl-C")
    for address, folder in serving.reviews.items():
        lines.append(f"To review {folder.name}: {address}")
    if serving.reviews:
        lines.append("Anyone with a review link sees the footage of held-out cameras and may change marks.")
    if len(serving.bases) > 1:
        lines.append(f"Other addresses of this machine: {', '.join(f'{base}/' for base in serving.bases[1:])}")
    if certificate is not None:
        lines.append(f"SHA-256 fingerprint of the certificate: {certificate.fingerprint}")
        if certificate.made:
            lines.append("Browsers warn of it, since it was made here; accept it if the fingerprint is the same.")
    if serving.is_local:
        lines.append("Only this machine can reach it; --host 0.0.0.0 lets phones and other machines in.")
    elif certificate is None and player:
        lines.append(
            "Over http, browsers on other machines decode with a <video> element, which is slower, and check no "
            "SHA-256. --https gives them WebCodecs, checksums and gamepads."
        )
    if serving.is_secret:
        lines.append("The link is secret: without all of it nothing is served; --no-token serves to everybody.")
    say("\n".join(lines))
    if player and not serving.is_local and sys.stdout.isatty():
        from v3studio.pipelines.share.addresses import qr_text

        address = serving.address if len(serving.streams) == 1 else f"{serving.bases[0]}/"
        address = next(iter(serving.reviews), address)
        print(f"{qr_text(address)}\n{address}", flush=True)


def _event(serving: Serving) -> ServingEvent:
    """The event that tells programs the first address of each stream, and all bases."""
    return ServingEvent(
        streams=tuple({"folder": str(folder), "address": address} for address, folder in serving.streams.items()),
        reviews=tuple({"folder": str(folder), "address": address} for address, folder in serving.reviews.items()),
        bases=tuple(serving.bases),
        local=serving.is_local,
        https=serving.certificate is not None,
        fingerprint=serving.fingerprint,
    )
