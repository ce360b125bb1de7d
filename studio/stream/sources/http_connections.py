"""HTTP connections whose waiting ends at a deadline in every phase of an answer, and on request from other threads.

A socket's timeout bounds one receive only: a server that drips bytes of a TLS handshake, a status line, headers, 1xx
answers, chunk sizes or trailers renews it with each byte.
"""

from __future__ import annotations

import contextlib
import os
import socket
import threading
import time
from typing import Any

import urllib3
from urllib3.connection import HTTPConnection, HTTPSConnection
from urllib3.connectionpool import HTTPConnectionPool, HTTPSConnectionPool

_current = threading.local()


class Watch:
    """Ends the connection that this thread uses in the block, if `progress` is not called within `seconds` from
    entering, and from each call to the next. `late`: that happened; the end of the connection may look like that of a
    complete answer."""

    def __init__(self, seconds: float) -> None:
        self._seconds = seconds
        self._deadline = time.monotonic() + seconds
        self._handle: socket.socket | None = None
        self._left: list[socket.socket] = []
        self._lock = threading.Lock()
        self._done = threading.Event()
        self._ended = False
        self.late = False

    def __enter__(self) -> Watch:
        _current.watch = self
        threading.Thread(target=self._wait, name="v3studio deadline", daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        self._done.set()
        _current.watch = None
        with self._lock:
            for handle in self._left:
                handle.close()

    def progress(self) -> None:
        """Data has arrived."""
        self._deadline = time.monotonic() + self._seconds

    def uses(self, handle: socket.socket) -> None:
        """The connection in use."""
        with self._lock:
            self._handle = handle
        if self._ended:
            self.end()

    def leaves(self, handle: socket.socket) -> None:
        """The connection is closed, but its answer may still be read (Connection: close)."""
        with self._lock:
            self._left.append(handle)

    def end(self) -> None:
        """End it now; from any thread."""
        with self._lock:
            self._ended = True
            if self._handle is not None and not self._done.is_set():
                with contextlib.suppress(OSError):
                    self._handle.shutdown(socket.SHUT_RDWR)

    def _wait(self) -> None:
        while (left := self._deadline - time.monotonic()) > 0:
            if self._done.wait(left):
                return
        self.late = True
        self.end()


class _Watched:
    """Tells the thread's `Watch` the connection that it uses.

    It gets a second descriptor of the socket, since TLS takes the first one away for the time of the handshake.
    """

    handle: socket.socket | None = None

    def _new_conn(self) -> socket.socket:
        sock: socket.socket = super()._new_conn()  # type: ignore[misc]
        self.handle = socket.socket(fileno=os.dup(sock.fileno()))
        self._tell()
        return sock

    def request(self, *arguments: Any, **options: Any) -> None:
        self._tell()
        super().request(*arguments, **options)  # type: ignore[misc]

    def close(self) -> None:
        super().close()  # type: ignore[misc]
        handle, self.handle = self.handle, None
        watch: Watch | None = getattr(_current, "watch", None)
        if handle is not None and watch is not None:
            watch.leaves(handle)
        elif handle is not None:
            handle.close()

    def _tell(self) -> None:
        watch: Watch | None = getattr(_current, "watch", None)
        if watch is not None and self.handle is not None:
            watch.uses(self.handle)


class _Plain(_Watched, HTTPConnection):
    pass


class _Encrypted(_Watched, HTTPSConnection):
    pass


class _PlainPool(HTTPConnectionPool):
    ConnectionCls = _Plain


class _EncryptedPool(HTTPSConnectionPool):
    ConnectionCls = _Encrypted


class WatchedPools(urllib3.PoolManager):
    """A urllib3.PoolManager whose connections a `Watch` can end."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        self.pool_classes_by_scheme = {"http": _PlainPool, "https": _EncryptedPool}
