"""`v3studio serve`: serves streams and the browser player over HTTP or HTTPS."""

from __future__ import annotations

import argparse
import contextlib
import errno
import json
import logging
import os
import re
import socket
import sys
import time
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO
from urllib.parse import quote

from studio.errors import StudioError

if TYPE_CHECKING:
    from starlette.applications import Starlette

    from pipelines.share.certificates import Certificate
    from pipelines.share.player_files import PlayerFiles

MANIFEST = "manifest.json"
TYPES = {".json": "application/json", ".mp4": "video/mp4"}
"""Content types by suffix; others are application/octet-stream."""

HASHED = re.compile(r"[0-9a-f]{32}\.[a-z0-9]{1,8}")
"""Files in the folder files/ of a stream of version 3, which never change under their names."""

_SHUTDOWN_SECONDS = 1  # for pending responses after Ctrl-C
_LOOK_SECONDS = 1.0  # between two looks for a stream that is yet to be published
_PLAYER_PATH = ".player"  # hidden files of streams are not served, so that no stream can have a folder of that name
_KEEP = "public, max-age=31536000, immutable"  # for files that are named by their content

HTTP_NOTE = (
    "Over http, browsers on other machines decode with a <video> element, which is slower, and check no SHA-256. "
    "--https gives them WebCodecs, checksums, the clipboard and gamepads."
)
"""What https would bring, where it is not used."""


def register(commands: Any) -> None:
    """Add the command to the command line."""
    serve = commands.add_parser(
        "serve",
        help="serve streams and the browser player",
        description="Serve a stream, the stream of a take, or all streams and takes in a folder, and the browser "
        "player: open the printed address in a browser to play it. Only files of streams are served, no other files of "
        "a take. A take that is being trained with --live is served from its first group on. Press Ctrl-C to stop.",
        allow_abbrev=False,
    )
    serve.add_argument("folder", metavar="DIR", help="folder of a stream or a take, or a folder of several")
    serve.add_argument(
        "--host",
        default="127.0.0.1",
        help="address to bind to; 0.0.0.0 for other machines (default: %(default)s)",
    )
    serve.add_argument("--port", type=int, default=8000, help="port to bind to; 0: any free port (default: 8000)")
    serve.add_argument(
        "--https",
        action="store_true",
        help="encrypt; without --certificate, one is made for this run: browsers warn of it, compare the printed "
        "fingerprint",
    )
    serve.add_argument("--certificate", type=Path, metavar="FILE", help="certificate in PEM format; implies --https")
    serve.add_argument("--key", type=Path, metavar="FILE", help="its private key, if it is not in the same file")
    serve.add_argument(
        "--qr",
        action=argparse.BooleanOptionalAction,
        help="print the address as a QR code (default: in a terminal, if other machines can reach the server)",
    )
    serve.add_argument("--json", action="store_true", help="print addresses and fingerprint as a JSON line")
    serve.set_defaults(command=_serve)


def find_streams(folder: str) -> dict[str, Path]:
    """Folders of streams by their path on the server: "/" for a single one, else "/<name>" per subfolder.

    Raises:
        StudioError: no stream in the folder (`serve.no_stream`), or a URL (`serve.not_a_folder`).
    """
    from pipelines.takes.locate_stream import stream_place

    place = stream_place(folder)
    if isinstance(place, str) or place.is_file():
        raise StudioError("serve.not_a_folder", "only folders can be served", file=folder, fix="Specify a folder.")
    if (place / MANIFEST).is_file():
        return {"/": place}
    found = {}
    for path in sorted(place.iterdir()):
        stream = path / "stream" if (path / "take.json").is_file() else path
        if not path.name.startswith(".") and (stream / MANIFEST).is_file():
            found[f"/{path.name}"] = stream
    if not found:
        raise StudioError(
            "serve.no_stream",
            f"no stream in this folder (no {MANIFEST})",
            file=folder,
            fix="Run `v3studio bake`, or specify another folder.",
        )
    return found


def build_app(streams: dict[str, Path], player: PlayerFiles | None = None) -> Starlette:
    """The web application: GET and HEAD of stream files, with ranges, CORS and revalidation, and the player.

    Only files in a stream's folder are served; hidden files and links out of the folder are not. Clients must
    revalidate every response (ETag), since a stream that is baked again keeps its file names; files of version 3, which
    are named by their content, may be kept forever. Browsers that ask for a stream's folder get the player's page, and
    for the list of several streams a page with links; other clients get the list of manifests as text.

    Args:
        streams: from `find_streams`.
        player: None for none.
    """
    from starlette.applications import Starlette
    from starlette.exceptions import HTTPException
    from starlette.middleware import Middleware
    from starlette.middleware.cors import CORSMiddleware
    from starlette.requests import Request
    from starlette.responses import FileResponse, HTMLResponse, PlainTextResponse, Response
    from starlette.routing import Mount, Route
    from starlette.staticfiles import StaticFiles
    from starlette.types import Scope

    hashed = {} if player is None else player.hashed
    uncached = {"Cache-Control": "no-cache", "Vary": "Accept"}

    class StreamFiles(StaticFiles):
        async def get_response(self, path: str, scope: Scope) -> Response:
            if player is not None and path == ".":
                assert self.directory is not None
                page = _page(player, f"../{_PLAYER_PATH}/", Path(self.directory))
                return HTMLResponse(page, headers=uncached)
            return await super().get_response(path, scope)

        def lookup_path(self, path: str) -> tuple[str, os.stat_result | None]:
            if any(part.startswith(".") for part in Path(path).parts):
                return "", None
            return super().lookup_path(path)

        def file_response(
            self, full_path: Any, stat_result: os.stat_result, scope: Scope, status_code: int = 200
        ) -> Response:
            response = super().file_response(full_path, stat_result, scope, status_code)
            named = HASHED.fullmatch(Path(full_path).name) and Path(full_path).parent.name == "files"
            response.headers["Cache-Control"] = _KEEP if named else "no-cache"
            response.headers["X-Content-Type-Options"] = "nosniff"
            response.headers["Cross-Origin-Resource-Policy"] = "cross-origin"
            if isinstance(response, FileResponse):
                kind = TYPES.get(Path(full_path).suffix.lower(), "application/octet-stream")
                response.headers["Content-Type"] = kind
            return response

    async def index(request: Request) -> Response:
        if player is not None and "text/html" in request.headers.get("accept", ""):
            if "/" in streams:
                return HTMLResponse(_page(player, f"{_PLAYER_PATH}/", streams["/"]), headers=uncached)
            return HTMLResponse(_list_page(streams), headers=uncached)
        base = str(request.base_url).rstrip("/")
        lines = [f"{base}{quote(path.rstrip('/'))}/{MANIFEST}" for path in streams]
        return PlainTextResponse("V3 Studio streams:\n" + "\n".join(lines) + "\n", headers=uncached)

    async def player_file(request: Request) -> Response:
        name = request.path_params["name"]
        if name not in hashed:
            raise HTTPException(404)
        kind = "text/javascript" if name.endswith(".js") else "text/plain"
        headers = {"Cache-Control": _KEEP, "X-Content-Type-Options": "nosniff"}
        return Response(hashed[name], media_type=kind, headers=headers)

    cors = Middleware(
        CORSMiddleware,
        allow_origins=["*"],
        allow_methods=["GET", "HEAD"],
        allow_headers=["Range", "If-Range", "If-None-Match", "If-Modified-Since"],
        expose_headers=["Accept-Ranges", "Content-Length", "Content-Range", "ETag", "Last-Modified"],
        max_age=86400,
    )
    mounts = [Mount(path.rstrip("/"), StreamFiles(directory=folder)) for path, folder in streams.items()]
    files = Route(f"/{_PLAYER_PATH}/{{name}}", player_file)
    return Starlette(routes=[Route("/", index), files, *mounts], middleware=[cors])


def _page(player: PlayerFiles, player_path: str, stream: Path) -> str:
    """The player's page for a stream beside it."""
    from pipelines.share.page import player_page
    from pipelines.share.results import PageText
    from pipelines.share.stream_files import name_of

    title = name_of(stream)
    with contextlib.suppress(OSError, ValueError, KeyError, TypeError, RecursionError):
        own = json.loads((stream / MANIFEST).read_bytes())["metadata"]["title"]  # the player reports what is damaged
        title = own if isinstance(own, str) and own.strip() else title
    script = f'<script type="module" src="{player_path}{player.script_name}"></script>'
    return player_page(player.page, script, MANIFEST, PageText(title=title))


def _list_page(streams: dict[str, Path]) -> str:
    """Links to the pages of several streams."""
    links = "\n".join(
        f'<li><a href="{escape(quote(path.removeprefix("/")))}/">{escape(path.removeprefix("/"))}</a></li>'
        for path in streams
    )
    return f"""<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="dark">
<title>V3 Studio streams</title>
<link rel="icon" href="data:,">
<style>
body {{
  margin: 0 auto; max-width: 34em; padding: 8vh 20px; background: #0b0d10; color: #eef1f4;
  font: 16px/1.5 system-ui, sans-serif;
}}
h1 {{ font-size: 18px; }}
ul {{ list-style: none; padding: 0; }}
a {{
  display: block; margin: 8px 0; padding: 14px 18px; border-radius: 12px; background: #16191f; color: inherit;
  text-decoration: none; overflow-wrap: anywhere;
}}
a:hover, a:focus-visible {{ background: #222731; }}
</style>
</head>
<body>
<h1>V3 Studio streams</h1>
<ul>
{links}
</ul>
</body>
</html>
"""


def listen(host: str, port: int) -> socket.socket:
    """Open a listening socket.

    Raises:
        StudioError: an invalid port (`command.invalid_option`), a port in use (`serve.port_in_use`), an unknown host
            (`serve.unknown_host`), or an address that cannot be bound (`serve.cannot_bind`).
    """
    if not 0 <= port <= 65535:
        raise StudioError(
            "command.invalid_option",
            f"--port {port}: not between 0 and 65535",
            value=port,
            fix="Example: 8000.",
            option="--port",
        )
    try:
        family, *_ = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)[0]
        return socket.create_server((host, port), family=family, backlog=128)
    except socket.gaierror as error:
        raise StudioError(
            "serve.unknown_host",
            f"unknown host '{host}' ({error.strerror})",
            value=host,
            fix="Specify an address of this machine with --host.",
            option="--host",
        ) from None
    except OSError as error:
        if error.errno == errno.EADDRINUSE:
            raise StudioError(
                "serve.port_in_use",
                f"port {port} is in use",
                value=port,
                fix="Specify another one with --port.",
                option="--port",
            ) from None
        raise StudioError(
            "serve.cannot_bind",
            f"cannot listen on {host}, port {port} ({error.strerror})",
            value=host,
            fix="Specify another address with --host, or another port with --port.",
            option="--host",
            port=port,
        ) from None


def _serve(arguments: argparse.Namespace) -> int:
    _wait_for_first_group(arguments.folder)
    streams = find_streams(arguments.folder)
    from pipelines.events.cancellation import EXIT_CANCELLED
    from pipelines.share.addresses import is_local, reachable_hosts

    hosts = reachable_hosts(arguments.host)
    certificate = _certificate(arguments, hosts)
    player = _player()
    with listen(arguments.host, arguments.port) as sock:
        import uvicorn

        config = uvicorn.Config(
            build_app(streams, player), log_level="warning", lifespan="off", timeout_graceful_shutdown=_SHUTDOWN_SECONDS
        )
        if certificate is not None:
            config.load()
            config.ssl = certificate.context
        port = sock.getsockname()[1]
        bases = [f"http{'s' * (certificate is not None)}://{host}:{port}" for host in hosts]
        local = is_local(arguments.host)
        if arguments.json:
            _print_json(arguments.output, streams, bases, local, certificate)
        else:
            _print(streams, bases, local, certificate, player is not None, arguments.qr)
        server = uvicorn.Server(config)
        # connections closed by Ctrl-C need no traceback
        logging.getLogger("uvicorn.error").addFilter(lambda record: not server.should_exit)
        # uvicorn raises its signal again on exit, but not always before `run` returns
        with contextlib.suppress(KeyboardInterrupt):
            server.run(sockets=[sock])
        return EXIT_CANCELLED if server.should_exit else 0


def _wait_for_first_group(folder: str) -> None:
    """Returns when a take that is baked live (`bake.live`) has a stream; at once for anything else."""
    from pipelines.config import load_config
    from pipelines.takes.take import Take

    root = Path(folder).expanduser()
    if not (root / "take.json").is_file():
        return
    take = Take.open(root)
    manifest = take.stream / MANIFEST
    if manifest.is_file() or not take.config.is_file() or not load_config(take.config).bake.live:
        return
    print(f"{folder}: waiting for the first group to be trained and baked", file=sys.stderr)
    while not manifest.is_file():
        time.sleep(_LOOK_SECONDS)


def _certificate(arguments: argparse.Namespace, hosts: list[str]) -> Certificate | None:
    from pipelines.share.certificates import load_certificate, make_certificate

    if arguments.certificate is not None:
        return load_certificate(arguments.certificate, arguments.key)
    if arguments.key is not None:
        raise StudioError(
            "command.invalid_option",
            "--key needs --certificate",
            value=arguments.key,
            fix="Specify the certificate that belongs to the key.",
            option="--key",
        )
    if not arguments.https:
        return None
    return make_certificate(sorted({*hosts, socket.gethostname(), "localhost", "127.0.0.1", "::1"}))


def _player() -> PlayerFiles | None:
    """The player; without it, streams are served all the same."""
    from pipelines.share.player_files import read_player

    try:
        return read_player()
    except StudioError as error:
        print(f"warning: {error} Streams are served without it.", file=sys.stderr)
        return None


def _print(
    streams: dict[str, Path],
    bases: list[str],
    local: bool,
    certificate: Certificate | None,
    player: bool,
    qr: bool | None,
) -> None:
    """Addresses, and what phones need."""
    first = f"{bases[0]}{quote(next(iter(streams)))}"
    lines = [f"Serving {folder} at {bases[0]}{quote(path)}" for path, folder in streams.items()]
    browser = "open the address in a browser, or run " if player else ""
    lines.append(f"To play: {browser}v3studio play --headless {first}    To stop: Ctrl-C")
    if len(bases) > 1:
        lines.append(f"Other addresses of this machine: {', '.join(f'{base}/' for base in bases[1:])}")
    if certificate is not None:
        lines.append(f"SHA-256 fingerprint of the certificate: {certificate.fingerprint}")
        if certificate.made:
            lines.append("Browsers warn of it, since it was made here; accept it if the fingerprint is the same.")
    if local:
        lines.append("Only this machine can reach it; --host 0.0.0.0 lets phones and other machines in.")
    elif certificate is None and player:
        lines.append(HTTP_NOTE)
    print("\n".join(lines), flush=True)
    if qr if qr is not None else player and not local and sys.stdout.isatty():
        from pipelines.share.qr_code import qr_text

        address = first if len(streams) == 1 else f"{bases[0]}/"
        print(f"{qr_text(address)}\n{address}", flush=True)


def _print_json(
    output: TextIO, streams: dict[str, Path], bases: list[str], local: bool, certificate: Certificate | None
) -> None:
    """One line for programs: the first address of each stream, and all bases."""
    event = {
        "kind": "serving",
        "streams": [{"folder": str(folder), "address": f"{bases[0]}{quote(path)}"} for path, folder in streams.items()],
        "bases": bases,
        "local": local,
        "https": certificate is not None,
        "fingerprint": None if certificate is None else certificate.fingerprint,
    }
    print(json.dumps(event), file=output, flush=True)
