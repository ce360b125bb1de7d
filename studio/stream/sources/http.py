"""A stream on a web server: HTTP(S) with timeouts, retries that resume, and bounded sizes.

The reader verifies the bytes against the SHA-256 in the manifest.
"""

import contextlib
import random
import threading
import time
from collections.abc import Iterator
from urllib.parse import unquote, urlsplit, urlunsplit

import urllib3

from v3studio.studio.errors import StudioError
from v3studio.studio.stream.sources.http_connections import Watch, WatchedPools
from v3studio.studio.stream.sources.redirects import MOST_REDIRECTS, redirected, same_origin
from v3studio.studio.stream.sources.source import Source, SourceUnavailable, is_address, too_long

CONNECT_SECONDS = 5.0
MIN_RATE = 16_000  # bytes per second, far below the bit rate of any stream

_CHUNK = 1 << 16
_RETRIED = (408, 425, 429, 500, 502, 503, 504)
_BACK_OFF = (0.1, 3.0)  # seconds before the second attempt and at most; doubles every time


class _Temporary(Exception):
    """Worth a retry. `retry_after`: seconds requested by the server."""

    def __init__(self, reason: str, problem: str, retry_after: float = 0.0) -> None:
        super().__init__(problem)
        self.reason = reason
        self.retry_after = retry_after


class _Partial:
    """The part of a file received so far, and the validator (ETag or date) of its version; `window`: first byte and
    number of bytes if only a part is wanted; `known`: ETag of a version that is known, and not wanted again."""

    def __init__(self, window: tuple[int, int] | None = None, known: str | None = None) -> None:
        self.data = bytearray()
        self.validator: str | None = None
        self.window = window
        self.size = 0  # of the whole file, from Content-Range
        self.known = known
        self.tag: str | None = None
        self.same = False  # the server answered that the file is the known one

    @property
    def begin(self) -> int:
        """Position in the file of the next byte."""
        return (self.window[0] if self.window else 0) + len(self.data)

    @property
    def wanted(self) -> str | None:
        """The range to request; None for the whole file."""
        if self.window is not None:
            return f"bytes={self.begin}-{sum(self.window) - 1}"
        return f"bytes={self.begin}-" if self.data else None

    def restart(self) -> None:
        self.data.clear()
        self.validator = None


class HttpSource(Source):
    """A stream below an http:// or https:// URL, that of its folder or of its manifest.json. Thread safe; connections
    are reused. A query (?token=...) is sent with every request; user:password@ before the host becomes basic
    authentication. `name` is the URL without both.

    Broken, stalled and refused connections and temporary status codes are retried with exponential backoff until
    `patience` runs out. Bytes already received are kept: a range request asks for the rest, with If-Range if the server
    sent an ETag or a date.
    """

    parallel = 6
    # seconds; an attempt is aborted if the server sends nothing for so long, or less than `MIN_RATE` on average over it
    stall = 8.0
    # seconds after a file's first failed attempt during which it is retried: enough to restart a server; and before the
    # server has ever answered, since a wrong URL is more likely than a slow server
    patience, first_patience = 30.0, 3.0

    def __init__(self, address: str) -> None:
        try:
            parts = urlsplit(address)
            host, port = parts.hostname, parts.port
        except ValueError as error:
            raise StudioError("source.invalid_url", f"invalid URL ({error})", file=address) from None
        if not is_address(address) or not host:
            fix = "Specify a URL that starts with http:// or https:// and a host."
            raise StudioError("source.invalid_url", "invalid URL", file=address, fix=fix)
        netloc = (f"[{host}]" if ":" in host else host) + ("" if port is None else f":{port}")
        self._base = parts._replace(
            netloc=netloc, path=parts.path.removesuffix("manifest.json").rstrip("/"), fragment=""
        )
        self.name = urlunsplit(self._base._replace(query=""))
        self._headers = {"Accept-Encoding": "identity", "User-Agent": "v3studio"}
        if parts.username is not None:
            login = f"{unquote(parts.username)}:{unquote(parts.password or '')}"
            self._headers.update(urllib3.make_headers(basic_auth=login))
        self._answered = False
        self._known: dict[str, str | None] = {}  # ETags of files that `read_changed` has read
        self._closed = threading.Event()
        self._live: set[Watch] = set()
        self._live_lock = threading.Lock()
        self._pool = WatchedPools(
            maxsize=self.parallel,
            timeout=urllib3.Timeout(connect=CONNECT_SECONDS, read=self.stall),
            # `read` does all retries, since it knows what has arrived, and follows redirects where that is safe.
            retries=urllib3.Retry(total=None, connect=0, read=0, status=0, other=0, redirect=0),
        )

    def read(self, path: str, limit: int) -> bytes:
        """Read a file as `Source.read` does. SourceUnavailable if there is no complete answer before `patience` runs
        out; StudioError if the file is missing, access is denied, or it is longer than `limit`."""
        return self._file(path, _Partial(), limit)

    def read_changed(self, path: str, limit: int) -> bytes | None:
        """Read a file if it has changed since the last call (asked with If-None-Match), else return None."""
        partial = _Partial(known=self._known.get(path))
        data = self._file(path, partial, limit)
        if partial.same:
            return None
        self._known[path] = partial.tag
        return data

    def _file(self, path: str, partial: _Partial, limit: int) -> bytes:
        url = urlunsplit(self._base._replace(path=f"{self._base.path}/{path}"))
        self._read(url, f"{self.name}/{path}", partial, limit)
        return bytes(partial.data)

    def read_at(self, offset: int, count: int) -> tuple[bytes, int]:
        """Up to `count` bytes from `offset` of the file that the URL itself names, fewer only at its end, and its size.
        StudioError as `read`, or if the server does not answer range requests."""
        partial = _Partial((offset, count))
        self._read(urlunsplit(self._base), self.name, partial, count)
        return bytes(partial.data), partial.size

    def _read(self, url: str, name: str, partial: _Partial, limit: int) -> None:
        began = time.monotonic()
        failing_since: float | None = None
        pause = _BACK_OFF[0]
        attempts = 0
        while True:
            if self._closed.is_set():
                raise StudioError("source.closed", "the stream was closed during the read", file=name)
            attempts += 1
            attempt_began = time.monotonic()
            try:
                self._attempt(url, name, partial, limit)
                return
            except _Temporary as error:
                if failing_since is None:
                    failing_since = attempt_began
                wait = max(pause * random.uniform(0.7, 1.3), error.retry_after)
                pause = min(2 * pause, _BACK_OFF[1])
                patience = self.patience if self._answered else self.first_patience
                if time.monotonic() + wait > failing_since + patience:
                    if self._closed.is_set():
                        continue
                    problem = f"{error} ({attempts} attempts in {time.monotonic() - began:.0f} s)"
                    fix = "Check the URL, the network and the server, then try again."
                    raise SourceUnavailable(
                        "source.unavailable", problem, file=name, fix=fix, reason=error.reason, attempts=attempts
                    ) from None
                self._closed.wait(wait)

    def _attempt(self, url: str, name: str, partial: _Partial, limit: int) -> None:
        """Request the file, or the missing rest of it."""
        headers = dict(self._headers)
        if partial.wanted is not None:
            headers["Range"] = partial.wanted
            if partial.validator is not None:
                headers["If-Range"] = partial.validator
        elif partial.known is not None:
            headers["If-None-Match"] = partial.known
        with self._watched() as watch:
            try:
                response = self._requested(url, name, headers, watch)
            except urllib3.exceptions.HTTPError as error:
                raise _late() if watch.late else _problem(name, error) from None
            self._answered = True
            complete = False
            try:
                self._receive(response, name, partial, limit, watch)
                if watch.late:
                    raise _late()
                complete = True
            except (urllib3.exceptions.HTTPError, OSError) as error:
                raise _late() if watch.late else _problem(name, error) from None
            finally:
                if complete:
                    response.release_conn()
                else:
                    response.close()  # late bytes must not become the answer to the next request

    def _requested(self, url: str, name: str, headers: dict[str, str], watch: Watch) -> urllib3.BaseHTTPResponse:
        """The answer at the end of all redirects."""
        origin = url
        for _ in range(MOST_REDIRECTS + 1):
            if not same_origin(origin, url):
                headers = {key: value for key, value in headers.items() if key.lower() != "authorization"}
            response = self._pool.request("GET", url, headers=headers, preload_content=False, redirect=False)
            location = response.get_redirect_location()
            if not location:
                return response
            response.close()
            url = redirected(url, location, name)
            watch.progress()
        raise StudioError("source.redirect_loop", "too many redirects", file=name, fix="Check the URL.")

    def _receive(
        self, response: urllib3.BaseHTTPResponse, name: str, partial: _Partial, limit: int, watch: Watch
    ) -> None:
        if watch.late:  # headers that end with the connection are no headers
            raise _late()
        watch.progress()
        if response.status == 304 and partial.known is not None:
            partial.same = True
            return
        _check_answer(response, name, partial)
        partial.tag = response.headers.get("ETag")
        length = response.headers.get("Content-Length", "")
        expected = (
            len(partial.data) + int(length) if length.isascii() and length.isdigit() and len(length) < 20 else None
        )
        if expected is not None and expected > limit:
            raise too_long(name, limit, expected)
        partial.validator = _validator(response)
        data = partial.data
        window, window_bytes = time.monotonic(), len(data)
        while True:
            # read1 returns what is available; read would wait for a full chunk at any rate
            chunk = response.read1(min(_CHUNK, limit + 1 - len(data)))
            if not chunk:
                break
            data += chunk
            watch.progress()
            if len(data) > limit:
                raise too_long(name, limit)
            now = time.monotonic()
            if now - window >= self.stall:
                if len(data) - window_bytes < MIN_RATE * (now - window):
                    raise _Temporary("too_slow", f"the server sends less than {MIN_RATE} bytes per second")
                window, window_bytes = now, len(data)
        if self._closed.is_set() or (expected is not None and len(data) < expected):
            raise _Temporary(
                "connection_closed", f"the server closed the connection after {len(data)} of {expected} bytes"
            )

    @contextlib.contextmanager
    def _watched(self) -> Iterator[Watch]:
        """A deadline for every phase of an answer; `close` ends it as well."""
        with Watch(self.stall) as watch:
            with self._live_lock:
                self._live.add(watch)
            try:
                if self._closed.is_set():
                    watch.end()
                yield watch
            finally:
                with self._live_lock:
                    self._live.discard(watch)

    def close(self) -> None:
        """Abort all reads, in whatever phase, and close the connections."""
        self._closed.set()
        with self._live_lock:
            for watch in self._live:
                watch.end()
        self._pool.clear()


def _check_answer(response: urllib3.BaseHTTPResponse, name: str, partial: _Partial) -> None:
    """Raises unless the body is the file, or the requested part of it."""
    status = response.status
    answer = f"the server answers {status} {response.reason or ''}".rstrip()
    if status in _RETRIED:
        after = response.headers.get("Retry-After", "")
        raise _Temporary("status", answer, float(after) if after.isascii() and after.isdigit() else 0.0)
    if status in (404, 410):
        problem = f"{answer}: the file is missing on the server"
        fix = "Check the URL, or upload the stream again."
        raise StudioError("source.file_missing", problem, file=name, fix=fix, status=status)
    if status in (401, 403):
        fix = "Ask for access, or put user:password@ before the host."
        raise StudioError("source.access_denied", answer, file=name, fix=fix, status=status)
    if status == 416 and partial.data:
        partial.restart()
        raise _Temporary("file_changed", "the file changed on the server during the read")
    if status == 206 and partial.wanted is not None:
        sent = response.headers.get("Content-Range", "")
        total = sent.rpartition("/")[2]
        if not sent.startswith(f"bytes {partial.begin}-") or (partial.window and not total.isdecimal()):
            partial.restart()
            raise _Temporary("wrong_range", "the server sent a different part of the file than requested")
        partial.size = int(total[:20]) if total.isdecimal() else 0
    elif status == 200 and partial.window is None:
        partial.restart()
    elif status == 200 or (status == 416 and partial.window is not None):
        fix = "Use a server that answers range requests, such as nginx or S3."
        raise StudioError("source.no_ranges", f"{answer} to a range request", file=name, fix=fix, status=status)
    else:
        raise StudioError("source.http_status", answer, file=name, fix="Check the URL.", status=status)
    encoding = response.headers.get("Content-Encoding", "identity").strip().lower()
    if encoding not in ("", "identity"):
        problem = f"the server sends the file with Content-Encoding {encoding}, which was not requested"
        fix = "Disable compression for streams on the server."
        raise StudioError("source.compressed", problem, file=name, value=encoding, fix=fix)


def _validator(response: urllib3.BaseHTTPResponse) -> str | None:
    """Value for If-Range: a strong ETag, otherwise the date."""
    tag = response.headers.get("ETag")
    if tag is not None and not tag.startswith("W/"):
        return tag
    return response.headers.get("Last-Modified")


def _late() -> _Temporary:
    return _Temporary("read_timeout", "the server stopped sending")


def _problem(name: str, error: Exception) -> Exception:
    """The error to raise, `_Temporary` if a retry may succeed."""
    reason = error.reason if isinstance(error, urllib3.exceptions.MaxRetryError) else error
    if isinstance(reason, urllib3.exceptions.SSLError):
        problem = f"no secure connection ({reason})"
        return StudioError("source.tls", problem, file=name, fix="Check the server's certificate.")
    if isinstance(reason, urllib3.exceptions.LocationParseError):
        return StudioError("source.invalid_url", f"invalid URL ({reason})", file=name)
    if isinstance(reason, urllib3.exceptions.NameResolutionError):
        return _Temporary("unknown_host", "the host name cannot be resolved")
    if isinstance(reason, urllib3.exceptions.NewConnectionError):
        return _Temporary("no_connection", "the server refuses the connection or cannot be reached")
    if isinstance(reason, urllib3.exceptions.ConnectTimeoutError):
        return _Temporary("connect_timeout", "the server does not answer")
    if isinstance(reason, urllib3.exceptions.ReadTimeoutError | TimeoutError):
        return _Temporary("read_timeout", "the server stopped sending")
    return _Temporary("connection_broken", f"the connection broke ({reason})")
