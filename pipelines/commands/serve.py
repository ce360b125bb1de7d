"""`v3studio serve`: serves streams over HTTP, for players on other machines and in browsers."""

from __future__ import annotations

import argparse
import contextlib
import errno
import logging
import os
import re
import socket
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from studio.errors import StudioError

if TYPE_CHECKING:
    from starlette.applications import Starlette

MANIFEST = "manifest.json"
TYPES = {".json": "application/json", ".mp4": "video/mp4"}
"""Content types by suffix; others are application/octet-stream."""

HASHED = re.compile(r"[0-9a-f]{32}\.[a-z0-9]{1,8}")
"""Files in the folder files/ of a stream of version 3, which never change under their names."""

_SHUTDOWN_SECONDS = 1  # for pending responses after Ctrl-C


def register(commands: Any) -> None:
    """Add the command to the command line."""
    serve = commands.add_parser(
        "serve",
        help="serve streams over HTTP",
        description="Serve a stream, the stream of a take, or all streams and takes in a folder over HTTP. Only files "
        "of streams are served, no other files of a take. Press Ctrl-C to stop.",
        allow_abbrev=False,
    )
    serve.add_argument("folder", metavar="DIR", help="folder of a stream or a take, or a folder of several")
    serve.add_argument(
        "--host",
        default="127.0.0.1",
        help="address to bind to; 0.0.0.0 for other machines (default: %(default)s)",
    )
    serve.add_argument("--port", type=int, default=8000, help="port to bind to; 0: any free port (default: 8000)")
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


def build_app(streams: dict[str, Path]) -> Starlette:
    """The web application: GET and HEAD of stream files, with ranges, CORS and revalidation.

    Only files in a stream's folder are served; hidden files and links out of the folder are not. Clients must
    revalidate every response (ETag), since a stream that is baked again keeps its file names; files of version 3, which
    are named by their content, may be kept forever.

    Args:
        streams: from `find_streams`.
    """
    from starlette.applications import Starlette
    from starlette.middleware import Middleware
    from starlette.middleware.cors import CORSMiddleware
    from starlette.requests import Request
    from starlette.responses import FileResponse, PlainTextResponse, Response
    from starlette.routing import Mount, Route
    from starlette.staticfiles import StaticFiles
    from starlette.types import Scope

    class StreamFiles(StaticFiles):
        def lookup_path(self, path: str) -> tuple[str, os.stat_result | None]:
            if any(part.startswith(".") for part in Path(path).parts):
                return "", None
            return super().lookup_path(path)

        def file_response(
            self, full_path: Any, stat_result: os.stat_result, scope: Scope, status_code: int = 200
        ) -> Response:
            response = super().file_response(full_path, stat_result, scope, status_code)
            named = HASHED.fullmatch(Path(full_path).name) and Path(full_path).parent.name == "files"
            response.headers["Cache-Control"] = "public, max-age=31536000, immutable" if named else "no-cache"
            response.headers["X-Content-Type-Options"] = "nosniff"
            response.headers["Cross-Origin-Resource-Policy"] = "cross-origin"
            if isinstance(response, FileResponse):
                kind = TYPES.get(Path(full_path).suffix.lower(), "application/octet-stream")
                response.headers["Content-Type"] = kind
            return response

    async def index(request: Request) -> Response:
        base = str(request.base_url).rstrip("/")
        lines = [f"{base}{quote(path.rstrip('/'))}/{MANIFEST}" for path in streams]
        return PlainTextResponse("V3 Studio streams:\n" + "\n".join(lines) + "\n")

    cors = Middleware(
        CORSMiddleware,
        allow_origins=["*"],
        allow_methods=["GET", "HEAD"],
        allow_headers=["Range", "If-Range", "If-None-Match", "If-Modified-Since"],
        expose_headers=["Accept-Ranges", "Content-Length", "Content-Range", "ETag", "Last-Modified"],
        max_age=86400,
    )
    mounts = [Mount(path.rstrip("/"), StreamFiles(directory=folder)) for path, folder in streams.items()]
    return Starlette(routes=[Route("/", index), *mounts], middleware=[cors])


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
    streams = find_streams(arguments.folder)
    from pipelines.events.cancellation import EXIT_CANCELLED

    with listen(arguments.host, arguments.port) as sock:
        import uvicorn

        config = uvicorn.Config(
            build_app(streams), log_level="warning", lifespan="off", timeout_graceful_shutdown=_SHUTDOWN_SECONDS
        )
        base = f"http://{_shown(arguments.host)}:{sock.getsockname()[1]}"
        for path, folder in streams.items():
            print(f"Serving {folder} at {base}{quote(path)}", flush=True)
        print(f"To play: v3studio play --headless {base}{quote(next(iter(streams)))}    To stop: Ctrl-C", flush=True)
        server = uvicorn.Server(config)
        # connections closed by Ctrl-C need no traceback
        logging.getLogger("uvicorn.error").addFilter(lambda record: not server.should_exit)
        # uvicorn raises its signal again on exit, but not always before `run` returns
        with contextlib.suppress(KeyboardInterrupt):
            server.run(sockets=[sock])
        return EXIT_CANCELLED if server.should_exit else 0


def _shown(host: str) -> str:
    """A host name for URLs."""
    if host in ("", "0.0.0.0", "::"):
        return socket.gethostname()
    return f"[{host}]" if ":" in host else host
