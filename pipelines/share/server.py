"""The server of `v3studio serve`: uvicorn's HTTP on connections that are accepted, counted and timed here.

uvicorn waits for a request for as long as a client drips bytes, counts only requests, and logs every failed accept. Of
the alternatives, hypercorn, granian and aiohttp have no limit of connections that answers, cheroot and waitress renew
their timeouts with every byte, and waitress has no TLS.
"""

import asyncio
import contextlib
import errno
import logging
import resource
import socket
import ssl
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import uvicorn
from starlette.types import ASGIApp
from uvicorn.protocols.http.h11_impl import H11Protocol

from v3studio.pipelines.share.certificates import Certificate
from v3studio.studio.errors import StudioError

_SHUTDOWN_SECONDS = 1  # for pending responses at the end
_REFUSAL = b"The server has as many connections as it can take. Try again in a few seconds.\n"
_BUSY = (
    b"HTTP/1.1 503 Service Unavailable\r\nConnection: close\r\nRetry-After: 5\r\nContent-Type: text/plain\r\n"
    b"Content-Length: %d\r\n\r\n%s" % (len(_REFUSAL), _REFUSAL)
)
_LATE = b"HTTP/1.1 408 Request Timeout\r\nConnection: close\r\nContent-Length: 0\r\n\r\n"


def _most_connections() -> int:
    """Half of the files that this process may open, since each connection also opens the file that it sends."""
    files = resource.getrlimit(resource.RLIMIT_NOFILE)[0]
    return max(8, min(512, (files - 64) // 2))


@dataclass(frozen=True)
class Limits:
    """Bounds of what clients can take."""

    connections: int = field(default_factory=_most_connections)  # open at the same time; further ones are answered 503
    request: float = 10.0  # seconds from the connection, or from the last answer, until a request has arrived
    idle: float = 5.0  # seconds without any data after which a connection between two requests is closed
    stall: float = 30.0  # seconds within which a client must take in what is buffered for it (some ten kilobytes)
    handshake: float = 10.0  # seconds for TLS to be set up
    refusals: int = 16  # connections at a time whose request is awaited, for a second, before they are refused


class _TimedHttp(H11Protocol):
    """HTTP/1.1 with a deadline whenever the server waits for the client."""

    def __init__(self, limits: Limits, ended: Callable[[], None], **arguments: Any) -> None:
        super().__init__(**arguments)
        self.made = False
        self._limits = limits
        self._ended = ended
        self._request_due: asyncio.TimerHandle | None = None
        self._stalled: asyncio.TimerHandle | None = None
        self._begun = False  # bytes of a request have arrived since the last answer

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        self.made = True
        super().connection_made(transport)
        self._expect_request()

    def connection_lost(self, exc: Exception | None) -> None:
        for timer in (self._request_due, self._stalled):
            if timer is not None:
                timer.cancel()
        super().connection_lost(exc)
        self._unset_keepalive_if_required()
        self._ended()

    def data_received(self, data: bytes) -> None:
        self._begun = True
        super().data_received(data)
        if self._answering:
            self._forget_request()

    def on_response_complete(self) -> None:
        super().on_response_complete()
        if self.transport.is_closing():
            self._abort_later()
        elif not self._answering:  # another request may have been waiting
            self._expect_request()

    def timeout_keep_alive_handler(self) -> None:
        super().timeout_keep_alive_handler()
        self._abort_later()

    def pause_writing(self) -> None:
        super().pause_writing()
        self._abort_later()

    def resume_writing(self) -> None:
        super().resume_writing()
        if self._stalled is not None and not self.transport.is_closing():
            self._stalled.cancel()
            self._stalled = None

    @property
    def _answering(self) -> bool:
        return self.cycle is not None and not self.cycle.response_complete

    def _expect_request(self) -> None:
        self._forget_request()
        self._begun = False
        self._request_due = self.loop.call_later(self._limits.request, self._too_late)

    def _forget_request(self) -> None:
        if self._request_due is not None:
            self._request_due.cancel()
            self._request_due = None

    def _too_late(self) -> None:
        if not self.transport.is_closing():
            if self._begun:
                self.transport.write(_LATE)
            self.transport.close()
            self._abort_later()

    def _abort_later(self) -> None:
        """`close` waits until everything is sent; a client that does not read would hold the connection forever."""
        if self._stalled is None:
            self._stalled = self.loop.call_later(self._limits.stall, self.transport.abort)


def listen(host: str, port: int) -> socket.socket:
    if not 0 <= port <= 65535:
        problem = f"--port {port}: not between 0 and 65535"
        raise StudioError("command.invalid_option", problem, value=port, fix="Example: 8000.", option="--port")
    try:
        family, *_ = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)[0]
        return socket.create_server((host, port), family=family, backlog=128)
    except socket.gaierror as error:
        problem = f"unknown host '{host}' ({error.strerror})"
        fix = "Specify an address of this machine with --host."
        raise StudioError("serve.unknown_host", problem, value=host, fix=fix, option="--host") from None
    except OSError as error:
        if error.errno == errno.EADDRINUSE:
            problem = f"port {port} is in use"
            fix = "Specify another one with --port."
            raise StudioError("serve.port_in_use", problem, value=port, fix=fix, option="--port") from None
        problem = f"cannot listen on {host}, port {port} ({error.strerror})"
        fix = "Specify another address with --host, or another port with --port."
        raise StudioError("serve.cannot_bind", problem, value=host, fix=fix, option="--host", port=port) from None


class BoundedServer(uvicorn.Server):
    """Serves an application on listening sockets within limits. `certificate`: None for http; `options`: of uvicorn."""

    def __init__(
        self, app: ASGIApp, certificate: Certificate | None = None, limits: Limits | None = None, **options: Any
    ) -> None:
        self.limits = limits or Limits()
        config = uvicorn.Config(
            app,
            server_header=False,
            http="h11",
            log_level="warning",
            lifespan="off",
            timeout_keep_alive=self.limits.idle,  # type: ignore[arg-type]
            timeout_graceful_shutdown=_SHUTDOWN_SECONDS,
            **options,
        )
        if certificate is not None:
            config.load()
            config.ssl = certificate.context
        super().__init__(config)
        self.open = 0
        self._refusing = 0
        self._tasks: set[asyncio.Task[None]] = set()

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Accept connections; called by uvicorn."""
        self.servers = []
        for sock in sockets or []:
            sock.setblocking(False)
            self._keep(self._accept(sock))
        self.started = True

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Accept no more and end open connections; called by uvicorn."""
        for task in list(self._tasks):
            task.cancel()
        await super().shutdown(sockets)

    def _keep(self, work: Any) -> None:
        task = asyncio.get_running_loop().create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _accept(self, sock: socket.socket) -> None:
        loop = asyncio.get_running_loop()
        while True:
            try:
                connection, _ = await loop.sock_accept(sock)
            except OSError:  # the client has gone, or no file can be opened for now
                await asyncio.sleep(0.1)
                continue
            if self.open < self.limits.connections:
                self.open += 1
                self._keep(self._serve_connection(connection))
            elif self.config.ssl is None and self._refusing < self.limits.refusals:
                self._refusing += 1
                self._keep(self._refuse(connection))
            else:
                connection.close()

    async def _serve_connection(self, connection: socket.socket) -> None:
        def ended() -> None:
            self.open -= 1

        protocol = _TimedHttp(
            self.limits, ended, config=self.config, server_state=self.server_state, app_state=self.lifespan.state
        )
        encrypted: dict[str, Any] = {}
        if self.config.ssl is not None:
            encrypted = {"ssl": self.config.ssl, "ssl_handshake_timeout": self.limits.handshake}
        try:
            loop = asyncio.get_running_loop()
            await loop.connect_accepted_socket(lambda: protocol, connection, **encrypted)
        except (OSError, ssl.SSLError, ConnectionError, TimeoutError):
            connection.close()
        finally:
            if not protocol.made:
                ended()

    async def _refuse(self, connection: socket.socket) -> None:
        """Answer 503. The request is read first: what has not been read would make the client miss the answer."""
        loop = asyncio.get_running_loop()
        try:
            connection.setblocking(False)
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(loop.sock_recv(connection, 65536), 1.0)
            with contextlib.suppress(BlockingIOError):
                connection.send(_BUSY)
        except OSError:
            pass
        finally:
            self._refusing -= 1
            connection.close()


class BoundedLog(logging.Filter):
    """Passes at most `most` records in `seconds`; the next one says how many were left out."""

    def __init__(self, most: int = 20, seconds: float = 60.0, clock: Callable[[], float] = time.monotonic) -> None:
        super().__init__()
        self._most, self._seconds, self._clock = most, seconds, clock
        self._began, self._passed, self._left_out = clock(), 0, 0

    def filter(self, record: logging.LogRecord) -> bool:
        now = self._clock()
        if now - self._began >= self._seconds:
            self._began, self._passed = now, 0
        if self._passed >= self._most:
            self._left_out += 1
            return False
        self._passed += 1
        if self._left_out:
            record.msg, self._left_out = f"({self._left_out} messages left out) {record.msg}", 0
        return True
