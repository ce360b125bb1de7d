"""`v3studio serve`: streams on a web server, for players on other machines and in browsers."""

from __future__ import annotations

import argparse
import contextlib
import errno
import logging
import os
import socket
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from pipelines.takes.locate_stream import stream_place
from studio.errors import StudioError

if TYPE_CHECKING:
    from starlette.applications import Starlette

MANIFEST = "manifest.json"
TYPES = {".json": "application/json", ".mp4": "video/mp4"}
"""Content types by ending; all else is application/octet-stream."""

_SHUTDOWN_SECONDS = 1  # for answers under way after Ctrl-C


def register(commands: Any) -> None:
    """Add the command to the command line."""
    serve = commands.add_parser(
        "serve",
        help="serve a stream over HTTP",
        description="Serve a stream, the stream of a take, or all streams and takes that lie in a folder. Only the "
        "streams' files are served, nothing else of a take. Ctrl-C stops it.",
        allow_abbrev=False,
    )
    serve.add_argument("folder", metavar="DIR", help="a stream's folder, a take's, or a folder of several of them")
    serve.add_argument("--host", default="127.0.0.1", help="address to listen at; 0.0.0.0 for other machines, too")
    serve.add_argument("--port", type=int, default=8000, help="port to listen at; 0 takes a free one (default: 8000)")
    serve.set_defaults(command=_serve)


def find_streams(folder: str) -> dict[str, Path]:
    """Streams by their path on the server: one at "/", or one a subfolder at "/<name>".

    Raises:
        StudioError: there is none.
    """
    place = stream_place(folder)
    if isinstance(place, str):
        raise StudioError(f"{folder}: only folders can be served.")
    if (place / MANIFEST).is_file():
        return {"/": place}
    found = {}
    for path in sorted(place.iterdir()):
        stream = path / "stream" if (path / "take.json").is_file() else path
        if not path.name.startswith(".") and (stream / MANIFEST).is_file():
            found[f"/{path.name}"] = stream
    if not found:
        raise StudioError(f"{folder}: there is no stream in it (no {MANIFEST}); bake one, or give another folder.")
    return found


def build_app(streams: dict[str, Path]) -> Starlette:
    """The web application: GET and HEAD of the streams' files, with ranges, CORS and revalidation.

    Files are found below a stream's folder only; names that begin with a dot, and links that lead out of the folder,
    are not found. Every answer is to be revalidated (ETag), because a stream that is baked again keeps its names.

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
            response.headers["Cache-Control"] = "no-cache"
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
    """A socket that listens.

    Raises:
        StudioError: the port is taken, not allowed, or the host is not one of this machine's.
    """
    if not 0 <= port <= 65535:
        raise StudioError(f"Port {port} does not exist; give one from 0 to 65535.")
    try:
        family, *_ = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)[0]
        return socket.create_server((host, port), family=family, backlog=128)
    except socket.gaierror as error:
        raise StudioError(f"Host '{host}' is not known ({error.strerror}); give an address of this machine.") from None
    except OSError as error:
        if error.errno == errno.EADDRINUSE:
            raise StudioError(f"Port {port} is taken by another program; choose one with --port.") from None
        raise StudioError(f"Cannot listen at {host} port {port} ({error.strerror}); choose another.") from None


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
            print(f"{folder} is served at {base}{quote(path)}", flush=True)
        print(f"Play it: v3studio play --headless {base}{quote(next(iter(streams)))}    Stop: Ctrl-C", flush=True)
        server = uvicorn.Server(config)
        # whoever is cut off by Ctrl-C is no error worth a traceback
        logging.getLogger("uvicorn.error").addFilter(lambda record: not server.should_exit)
        # uvicorn raises the signal that ended it again, but not always in time for us to see it
        with contextlib.suppress(KeyboardInterrupt):
            server.run(sockets=[sock])
        return EXIT_CANCELLED if server.should_exit else 0


def _shown(host: str) -> str:
    """A host that others can use in an address."""
    if host in ("", "0.0.0.0", "::"):
        return socket.gethostname()
    return f"[{host}]" if ":" in host else host
