"""A stream on a web server: files over HTTP(S), with time limits, retries that go on where the last one broke off, and
bounded sizes. What the bytes are worth is checked by the reader, against the manifest's SHA-256."""

from __future__ import annotations

import contextlib
import random
import threading
import time
from collections.abc import Iterator
from urllib.parse import unquote, urlsplit, urlunsplit

import urllib3

from studio.errors import StudioError
from studio.stream.source import SourceUnavailable, is_address

CONNECT_SECONDS = 5.0
STALL_SECONDS = 8.0
"""A server that sends nothing for so long, or less than `MIN_RATE` over such a span, is given up for this attempt."""

MIN_RATE = 16_000
"""Bytes a second; far below what any stream needs to be played."""

PATIENCE = 30.0
"""Seconds from a file's first failed attempt after which no other begins: time enough for a server to be restarted."""

FIRST_PATIENCE = 3.0
"""The same before the server has ever answered: the address is more likely to be wrong than the server to be late."""

_CHUNK = 1 << 16
_RETRIED = (408, 425, 429, 500, 502, 503, 504)
_BACK_OFF = (0.1, 3.0)  # seconds before the second attempt, and at the most; doubled from one to the next


class _Temporary(Exception):
    """Worth another attempt. `retry_after`: seconds that the server asks for."""

    def __init__(self, problem: str, retry_after: float = 0.0) -> None:
        super().__init__(problem)
        self.retry_after = retry_after


class _Partial:
    """What has come of one file so far, and the server's mark of the version it came from."""

    def __init__(self) -> None:
        self.data = bytearray()
        self.mark: str | None = None

    def restart(self) -> None:
        self.data.clear()
        self.mark = None


class HttpSource:
    """A stream below an http:// or https:// address. Thread safe; connections are kept and used again.

    A connection that breaks, stalls or is refused, and the statuses that say "later", are tried again with growing
    pauses until `patience` is used up; what has arrived is kept and only the rest asked for (a range request, bound
    to the same version of the file by If-Range where the server gives its files an ETag or a date).

    Args:
        address: of the stream's folder or of its manifest.json; a query (?token=...) goes with every request, a name
            and password before the host become basic authentication.
        stall, patience, first_patience: seconds, see the constants of this module.

    Raises:
        StudioError: this is no http(s) address.
    """

    parallel = 6

    def __init__(
        self,
        address: str,
        *,
        stall: float = STALL_SECONDS,
        patience: float = PATIENCE,
        first_patience: float = FIRST_PATIENCE,
    ) -> None:
        try:
            parts = urlsplit(address)
            host, port = parts.hostname, parts.port
        except ValueError as error:
            raise StudioError(f"{address}: this is not a usable address ({error}).") from None
        if not is_address(address) or not host:
            raise StudioError(f"{address}: give an address that begins with http:// or https:// and names a server.")
        netloc = (f"[{host}]" if ":" in host else host) + ("" if port is None else f":{port}")
        self._base = parts._replace(
            netloc=netloc, path=parts.path.removesuffix("manifest.json").rstrip("/"), fragment=""
        )
        self._headers = {"Accept-Encoding": "identity", "User-Agent": "v3studio"}
        if parts.username is not None:
            login = f"{unquote(parts.username)}:{unquote(parts.password or '')}"
            self._headers.update(urllib3.make_headers(basic_auth=login))
        self._stall = stall
        self._patience = patience
        self._first_patience = min(first_patience, patience)
        self._answered = False
        self._closed = threading.Event()
        self._live: set[urllib3.BaseHTTPResponse] = set()
        self._live_lock = threading.Lock()
        self._pool = urllib3.PoolManager(
            maxsize=self.parallel,
            timeout=urllib3.Timeout(connect=CONNECT_SECONDS, read=stall),
            # Redirections are followed here; all else is retried by `read`, which knows what has arrived.
            retries=urllib3.Retry(total=None, connect=0, read=0, status=0, other=0, redirect=5),
        )

    @property
    def name(self) -> str:
        """The address, without password and query."""
        return urlunsplit(self._base._replace(query=""))

    def read(self, path: str, limit: int) -> bytes:
        """See `Source.read`.

        Raises:
            SourceUnavailable: no answer, or not all of it, within the patience.
            StudioError: the server answers that the file is missing or not to be had, or it is longer than `limit`.
        """
        url = urlunsplit(self._base._replace(path=f"{self._base.path}/{path}"))
        name = f"{self.name}/{path}"
        partial = _Partial()
        began = time.monotonic()
        failing_since: float | None = None
        pause = _BACK_OFF[0]
        attempts = 0
        while True:
            if self._closed.is_set():
                raise StudioError(f"{name}: the stream was closed while it was being read.")
            attempts += 1
            attempt_began = time.monotonic()
            try:
                self._attempt(url, name, partial, limit)
                return bytes(partial.data)
            except _Temporary as problem:
                if failing_since is None:
                    failing_since = attempt_began
                wait = max(pause * random.uniform(0.7, 1.3), problem.retry_after)
                pause = min(2 * pause, _BACK_OFF[1])
                patience = self._patience if self._answered else self._first_patience
                if time.monotonic() + wait > failing_since + patience:
                    if self._closed.is_set():
                        continue
                    raise SourceUnavailable(
                        f"{name}: {problem} ({attempts} attempts in {time.monotonic() - began:.0f} s); "
                        "check the address, the network and the server, then try again."
                    ) from None
                self._closed.wait(wait)

    def _attempt(self, url: str, name: str, partial: _Partial, limit: int) -> None:
        """Ask for the file, or for what is missing of it."""
        headers = dict(self._headers)
        if partial.data:
            headers["Range"] = f"bytes={len(partial.data)}-"
            if partial.mark is not None:
                headers["If-Range"] = partial.mark
        try:
            response = self._pool.request("GET", url, headers=headers, preload_content=False)
        except urllib3.exceptions.HTTPError as error:
            raise _problem(name, error) from None
        self._answered = True
        complete = False
        try:
            with self._tracked(response):
                self._receive(response, name, partial, limit)
            complete = True
        except (urllib3.exceptions.HTTPError, OSError) as error:
            raise _problem(name, error) from None
        finally:
            if complete:
                response.release_conn()
            else:
                response.close()  # what may still come must not be taken for the answer to the next request

    def _receive(self, response: urllib3.BaseHTTPResponse, name: str, partial: _Partial, limit: int) -> None:
        _check_answer(response, name, partial)
        length = response.headers.get("Content-Length", "")
        expected = len(partial.data) + int(length) if length.isascii() and length.isdigit() else None
        if expected is not None and expected > limit:
            raise StudioError(
                f"{name}: the server has {expected} bytes, at most {limit} are expected; bake or upload it again."
            )
        partial.mark = _mark(response)
        data = partial.data
        window, window_bytes = time.monotonic(), len(data)
        while True:
            # read1 gives what is there; read would wait for a whole chunk, however slowly it trickles in
            chunk = response.read1(min(_CHUNK, limit + 1 - len(data)))
            if not chunk:
                break
            data += chunk
            if len(data) > limit:
                raise StudioError(f"{name}: the file is longer than {limit} bytes; bake or upload it again.")
            now = time.monotonic()
            if now - window >= self._stall:
                if len(data) - window_bytes < MIN_RATE * (now - window):
                    raise _Temporary(f"the server sends less than {MIN_RATE} bytes a second")
                window, window_bytes = now, len(data)
        if self._closed.is_set() or (expected is not None and len(data) < expected):
            raise _Temporary(f"the server closed the connection after {len(data)} of {expected} bytes")

    @contextlib.contextmanager
    def _tracked(self, response: urllib3.BaseHTTPResponse) -> Iterator[None]:
        with self._live_lock:
            self._live.add(response)
        try:
            yield
        finally:
            with self._live_lock:
                self._live.discard(response)

    def close(self) -> None:
        """End all reads soon, and drop the connections."""
        self._closed.set()
        with self._live_lock:
            for response in self._live:
                with contextlib.suppress(Exception):  # it may just have ended by itself
                    response.shutdown()
        self._pool.clear()


def _check_answer(response: urllib3.BaseHTTPResponse, name: str, partial: _Partial) -> None:
    """Raises unless the body is the file, or the part of it that was asked for."""
    status = response.status
    said = f"the server answers {status} {response.reason or ''}".rstrip()
    if status in _RETRIED:
        after = response.headers.get("Retry-After", "")
        raise _Temporary(said, float(after) if after.isascii() and after.isdigit() else 0.0)
    if status in (404, 410):
        raise StudioError(f"{name}: {said}: the file is missing there; check the address, or upload the stream again.")
    if status in (401, 403):
        raise StudioError(f"{name}: {said}; it may not be read; ask for access, or put user:password@ before the host.")
    if status == 416 and partial.data:
        partial.restart()
        raise _Temporary("the file changed on the server while it was being read")
    if status == 206 and partial.data:
        if not response.headers.get("Content-Range", "").startswith(f"bytes {len(partial.data)}-"):
            partial.restart()
            raise _Temporary("the server sent another part of the file than was asked for")
    elif status == 200:
        partial.restart()
    else:
        raise StudioError(f"{name}: {said}; check the address.")
    encoding = response.headers.get("Content-Encoding", "identity").strip().lower()
    if encoding not in ("", "identity"):
        raise StudioError(
            f"{name}: the server sends it compressed ({encoding}), though asked not to; switch that off for streams."
        )


def _mark(response: urllib3.BaseHTTPResponse) -> str | None:
    """What If-Range may compare: a strong ETag, else the date."""
    tag = response.headers.get("ETag")
    if tag is not None and not tag.startswith("W/"):
        return tag
    return response.headers.get("Last-Modified")


def _problem(name: str, error: Exception) -> Exception:
    """What went wrong, in words; whether it may pass."""
    reason = error.reason if isinstance(error, urllib3.exceptions.MaxRetryError) else error
    if isinstance(reason, urllib3.exceptions.SSLError):
        return StudioError(f"{name}: no secure connection ({reason}); check the server's certificate.")
    if isinstance(reason, urllib3.exceptions.LocationParseError):
        return StudioError(f"{name}: this is not a usable address ({reason}).")
    if isinstance(reason, urllib3.exceptions.ResponseError):  # redirected too often
        return StudioError(f"{name}: the server sends in circles ({reason}); check the address.")
    if isinstance(reason, urllib3.exceptions.NameResolutionError):
        return _Temporary("the server's name is not known")
    if isinstance(reason, urllib3.exceptions.NewConnectionError):
        return _Temporary("the server refuses the connection or cannot be reached")
    if isinstance(reason, urllib3.exceptions.ConnectTimeoutError):
        return _Temporary("the server does not answer")
    if isinstance(reason, urllib3.exceptions.ReadTimeoutError | TimeoutError):
        return _Temporary("the server stopped sending")
    return _Temporary(f"the connection broke ({reason})")
