"""The web application of `v3studio serve`: streams, the browser player, reviews."""

import contextlib
import gzip
import ipaddress
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from html import escape
from pathlib import Path
from typing import Any
from urllib.parse import quote

from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.middleware.cors import CORSMiddleware
from starlette.requests import Request
from starlette.responses import FileResponse, HTMLResponse, PlainTextResponse, Response
from starlette.routing import BaseRoute, Mount, Route
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp, Receive, Scope, Send

from v3studio.pipelines.review.api import FOLDER, review_routes
from v3studio.pipelines.review.take_review import TakeReview
from v3studio.pipelines.share.page import PageText, first_files, player_page, script_elements
from v3studio.pipelines.share.player_files import PlayerFiles
from v3studio.pipelines.share.stream_to_share import name_of
from v3studio.studio.bounded_files import parse_json
from v3studio.studio.errors import plain_text, visible
from v3studio.studio.stream.manifest import MANIFEST_NAME

TYPES = {".json": "application/json", ".mp4": "video/mp4", ".m4a": "audio/mp4"}
"""Content types by suffix; others are application/octet-stream."""

HASHED = re.compile(r"[0-9a-f]{32}\.[a-z0-9]{1,8}")
"""Files in the folder files/ of a stream, which never change under their names."""

_PLAYER_PATH = ".player"  # hidden files of streams are not served, so that no stream can have a folder of that name
_PACKED = b'-gzip"'  # end of the ETag of a compressed response
_KEEP = "public, max-age=31536000, immutable"  # for files that are named by their content
_UNCACHED = {"Cache-Control": "no-cache", "Vary": "Accept"}  # for pages
_MOST_RANGES = 8  # in one request
_METHODS = ("GET", "HEAD")


@dataclass(frozen=True)
class Reviews:
    """Takes that can be reviewed, by the paths of their streams. `secret`: part of links that only reviewers know."""

    secret: str
    takes: Mapping[str, TakeReview]


def build_app(
    streams: dict[str, Path],
    player: PlayerFiles | None = None,
    reviews: Reviews | None = None,
    secret: str = "",
    names: Sequence[str] = (),
    origins: Sequence[str] = (),
    text: PageText | None = None,
) -> Starlette:
    """The web application: GET and HEAD of stream files, with ranges and revalidation, and the player.

    Only files in a stream's folder are served; hidden files and links out of the folder are not. Clients must
    revalidate every response (ETag), since the manifest of a stream that is baked again keeps its name; the other
    files, which are named by their content, may be kept forever. Browsers that ask for a stream's folder get the
    player's page, and for the list of several streams a page with links; other clients get the list of manifests as
    text.

    Args:
        streams: from `find_streams`.
        player: None for none.
        reviews: None for none. Below its secret path, the same is served again, with the takes' reviews.
        secret: part of the path that requests must begin with; "" for none.
        names: of this server, besides addresses and localhost; requests to others are refused.
        origins: pages of these ("https://example.org", or "*") may read the streams and show the player in a frame, but
            not the reviews. In a frame, the player tells the page around it the title and what is shown.
        text: of the pages; without a title, it is each stream's own, else its name.
    """
    cors = Middleware(
        CORSMiddleware,
        allow_origins=list(origins),
        allow_methods=list(_METHODS),
        allow_headers=["Range", "If-Range", "If-None-Match", "If-Modified-Since"],
        expose_headers=["Accept-Ranges", "Content-Length", "Content-Range", "ETag", "Last-Modified"],
        max_age=86400,
    )
    text = text or PageText()
    routes = _Site(streams, player, {}, origins, text, None).routes()
    if secret:
        routes = [Mount(f"/{secret}", routes=routes)]
    if reviews is not None:
        watching = f"../{secret}/" if secret else "../"
        review = _Site(streams, player, reviews.takes, (), text, watching).routes()
        routes.insert(0, Mount(f"/{reviews.secret}", routes=review))
    return Starlette(routes=routes, middleware=[Middleware(_HostCheck, names=names), *([cors] if origins else [])])


def is_allowed(host: str, names: Iterable[str]) -> bool:
    """Return whether a Host header names this server: an IP address, localhost, or one of the names.

    An address cannot be rebound, and a server is reached by addresses that it does not know, such as those of a router.
    """
    bare = host.strip().lower()
    if bare.startswith("["):
        bare = bare[1:].partition("]")[0]
    elif bare.count(":") == 1:
        bare = bare.partition(":")[0]
    bare = bare.removesuffix(".")
    if bare == "localhost" or bare.endswith(".localhost") or bare in {name.lower() for name in names}:
        return True
    try:
        ipaddress.ip_address(bare.partition("%")[0])
    except ValueError:
        return False
    return True


class _HostCheck:
    """ASGI middleware: 421 for requests whose Host header names another server. Otherwise a page on the web whose name
    its owner lets point to this machine (DNS rebinding) could read what is served."""

    def __init__(self, app: ASGIApp, names: Iterable[str] = ()) -> None:
        self._app, self._names = app, tuple(names)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "http":
            hosts = [value.decode("latin-1") for name, value in scope["headers"] if name == b"host"]
            if len(hosts) != 1 or not is_allowed(hosts[0], self._names):
                text = "This server does not have this name. Start it with --allow-host NAME to give it one.\n"
                await PlainTextResponse(text, 421)(scope, receive, send)
                return
        await self._app(scope, receive, send)


@dataclass(frozen=True)
class _Site:
    """The streams with the player, as for `build_app`, with their reviews by the path of their stream, or without.
    `origins`: whose pages may read and frame what is served, beside its own. `watching`: where, below "/", the same is
    served without reviews, which pages copy as a link; None: the pages."""

    streams: dict[str, Path]
    player: PlayerFiles | None
    reviews: Mapping[str, TakeReview]
    origins: Sequence[str]
    text: PageText
    watching: str | None

    def routes(self) -> list[BaseRoute]:
        """Routes to the list of streams, the player, the reviews and the streams."""
        reviews = {f"{path.rstrip('/')}/{FOLDER}": review for path, review in self.reviews.items()}
        return [
            Route("/", self._index),
            Route(f"/{_PLAYER_PATH}/{{name}}", self._player_file),
            *(_exactly(path, Mount("", routes=review_routes(review))) for path, review in reviews.items()),
            *(_exactly(path.rstrip("/"), Mount("", _StreamFiles(self, path))) for path in self.streams),
        ]

    def page(self, path: str) -> str:
        """The player's page for a stream, with what a review adds to it."""
        assert self.player is not None
        stream, up = self.streams[path], "" if path == "/" else "../"
        title = self.text.title or name_of(stream)
        first: list[str] = []
        with contextlib.suppress(OSError, ValueError, KeyError, TypeError, RecursionError):
            # the player reports what is damaged
            manifest = (stream / MANIFEST_NAME).read_bytes()
            first = first_files(manifest)
            own = parse_json(manifest)["metadata"]["title"]
            title = self.text.title or (plain_text(own) if isinstance(own, str) else "") or title
        scripts = script_elements(self.player.hashed(path in self.reviews), f"{up}{_PLAYER_PATH}/")
        own = "" if path == "/" else f"{quote(path.removeprefix('/'))}/"
        link = None if self.watching is None else f"{up}{self.watching}{own}"
        text = replace(self.text, title=title)
        return player_page(self.player.page, scripts, MANIFEST_NAME, text, link=link, first=first)

    def answer(self, page: str) -> Response:
        """A page, which only pages of the allowed origins may show in a frame."""
        allowed = ("'self'", *self.origins)
        framing = {"Content-Security-Policy": f"frame-ancestors {' '.join(allowed)}"}
        return HTMLResponse(page, headers={**_UNCACHED, **framing})

    async def _index(self, request: Request) -> Response:
        if self.player is not None and "text/html" in request.headers.get("accept", ""):
            page = self.page("/") if "/" in self.streams else _list_page(self.streams)
            return self.answer(page)
        own = request.url  # with the secret part, which base_url lacks
        base = f"{own.scheme}://{own.netloc}{own.path.rpartition('/')[0]}"
        lines = [f"{base}{quote(path.rstrip('/'))}/{MANIFEST_NAME}" for path in self.streams]
        return PlainTextResponse("V3 Studio streams:\n" + "\n".join(lines) + "\n", headers=_UNCACHED)

    @cached_property
    def _player_files(self) -> dict[str, tuple[bytes, bytes]]:
        """The player's files, plain and compressed, by hashed names."""
        files = {} if self.player is None else self.player.hashed(bool(self.reviews))
        return {name: (data, gzip.compress(data, mtime=0)) for name, data in files.items()}

    async def _player_file(self, request: Request) -> Response:
        name = request.path_params["name"]
        if name not in self._player_files:
            raise HTTPException(404)
        plain, packed = self._player_files[name]
        kind = "text/javascript" if name.endswith(".js") else "text/plain"
        headers = {"Cache-Control": _KEEP, "X-Content-Type-Options": "nosniff", "Vary": "Accept-Encoding"}
        if not _takes_gzip(request.scope):
            return Response(plain, media_type=kind, headers=headers)
        return Response(packed, media_type=kind, headers={**headers, "Content-Encoding": "gzip"})


class _StreamFiles(StaticFiles):
    """Files of a stream of a site, and its page in place of its folder."""

    def __init__(self, site: _Site, path: str) -> None:
        super().__init__(directory=site.streams[path])
        self._site, self._path = site, path

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if not all(usable_range(value) for name, value in scope["headers"] if name == b"range"):
            kept = [(name, value) for name, value in scope["headers"] if name != b"range"]
            scope = {**scope, "headers": kept}
        await super().__call__(scope, receive, send)

    async def get_response(self, path: str, scope: Scope) -> Response:
        if scope["method"] not in _METHODS:
            raise HTTPException(405, headers={"Allow": ", ".join(_METHODS)})
        if self._site.player is not None and path == ".":
            return self._site.answer(self._site.page(self._path))
        if not path.endswith(".json") or not _takes_gzip(scope):
            return await super().get_response(path, scope)
        # the manifest and the pages of the index: what a player must have before the first image
        plain = {**scope, "headers": [(name, value.replace(_PACKED, b'"')) for name, value in scope["headers"]]}
        response = await super().get_response(path, plain)
        return _packed(response) if isinstance(response, FileResponse) else response

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
        response.headers["Cross-Origin-Resource-Policy"] = "cross-origin" if self._site.origins else "same-origin"
        if isinstance(response, FileResponse):
            kind = TYPES.get(Path(full_path).suffix.lower(), "application/octet-stream")
            response.headers["Content-Type"] = kind
        return response


def _exactly(path: str, mount: Mount) -> Mount:
    """Mount at a path as it is: in those that Starlette is given, `{name}` stands for anything."""
    mount.path_regex = re.compile(f"^{re.escape(path)}/(?P<path>.*)$")
    return mount


def _takes_gzip(scope: Any) -> bool:
    """Return whether the client takes compressed responses and asks for a whole file."""
    headers = dict(scope["headers"])
    return b"gzip" in headers.get(b"accept-encoding", b"") and b"range" not in headers


def _packed(response: FileResponse) -> Response:
    """A whole file, compressed; its ETag says so, since the bytes are others."""
    headers = {name: value for name, value in response.headers.items() if name != "content-length"}
    headers["etag"] = headers["etag"].removesuffix('"') + _PACKED.decode()
    data = gzip.compress(Path(response.path).read_bytes(), 6, mtime=0)
    return Response(data, headers={**headers, "Content-Encoding": "gzip", "Vary": "Accept-Encoding"})


def usable_range(header: bytes) -> bool:
    """Return whether a Range header is to be followed; others are ignored (RFC 9110, 14.2).

    Those are other units, malformed and reversed ranges, and many ranges in one request.
    """
    unit, equals, ranges = header.decode("latin-1").partition("=")
    if not equals or unit.strip().lower() != "bytes":
        return False
    parts = ranges.split(",")
    if len(parts) > _MOST_RANGES:
        return False
    for part in parts:
        bounds = re.fullmatch(r"[ \t]*(?:([0-9]{1,15})-([0-9]{0,15})|-[0-9]{1,15})[ \t]*", part)
        if bounds is None or (bounds[2] and int(bounds[2]) < int(bounds[1])):
            return False
    return True


def _list_page(streams: dict[str, Path]) -> str:
    """Links to the pages of several streams."""
    template = Path(__file__).with_name("streams.html").read_text(encoding="utf-8")
    names = [path.removeprefix("/") for path in streams]
    links = [f'<li><a href="{escape(quote(name))}/">{escape(visible(name))}</a></li>' for name in names]
    return template.replace("<!-- v3:streams -->", "\n".join(links))
