"""A slow network on this machine: a TCP proxy with a limited rate and a round-trip time."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Coroutine
from types import TracebackType
from typing import Any

_CHUNK = 4096
_QUEUED = 64  # chunks on their way in one connection


class SlowNetwork:
    """Relays connections to a port of this machine. All connections share one link for what the server sends.

    Opening a connection takes one round trip, as in TCP; a connection may use the whole rate at once (no slow start),
    and nothing is lost.

    Args:
        port: of the server on 127.0.0.1.
        megabits: rate of the link in Mbit/s; None: no limit. It may be changed at any time.
        round_trip: seconds.

    Attributes:
        port: of the proxy on 127.0.0.1.
        sent: bytes that were sent to clients.
    """

    def __init__(self, port: int, megabits: float | None = None, round_trip: float = 0.0) -> None:
        self.megabits, self.round_trip = megabits, round_trip
        self.sent = 0
        self._target = port
        self._free_at = 0.0  # when the link has sent what is queued
        self._loop = asyncio.new_event_loop()
        self._tasks: set[asyncio.Task[None]] = set()
        self._thread = threading.Thread(target=self._loop.run_forever, name="slow-network", daemon=True)
        self._thread.start()
        serving = asyncio.run_coroutine_threadsafe(asyncio.start_server(self._accept, "127.0.0.1", 0), self._loop)
        self._server = serving.result()
        self.port: int = self._server.sockets[0].getsockname()[1]

    async def _accept(self, client: asyncio.StreamReader, to_client: asyncio.StreamWriter) -> None:
        await asyncio.sleep(self.round_trip)
        server, to_server = await asyncio.open_connection("127.0.0.1", self._target)
        for source, target, limited in ((client, to_server, False), (server, to_client, True)):
            self._begin(self._relay(source, target, limited))

    def _begin(self, work: Coroutine[Any, Any, None]) -> asyncio.Task[None]:
        task = self._loop.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        return task

    async def _relay(self, source: asyncio.StreamReader, target: asyncio.StreamWriter, limited: bool) -> None:
        queue: asyncio.Queue[tuple[float, bytes]] = asyncio.Queue(_QUEUED)
        delivering = self._begin(self._deliver(queue, target, limited))
        try:
            while data := await source.read(_CHUNK):
                await queue.put((self._arrival(len(data), limited), data))
        except ConnectionError:
            pass
        await queue.put((0.0, b""))
        await delivering

    def _arrival(self, size: int, limited: bool) -> float:
        now = self._loop.time()
        if limited and self.megabits is not None:
            self._free_at = max(now, self._free_at) + 8e-6 * size / self.megabits
            now = self._free_at
        return now + self.round_trip / 2

    async def _deliver(
        self, queue: asyncio.Queue[tuple[float, bytes]], target: asyncio.StreamWriter, limited: bool
    ) -> None:
        try:
            while (item := await queue.get())[1]:
                await asyncio.sleep(max(0.0, item[0] - self._loop.time()))
                target.write(item[1])
                await target.drain()
                self.sent += len(item[1]) if limited else 0
        except ConnectionError:
            while (await queue.get())[1]:
                pass  # the client has gone; nothing may wait for room in the queue
        finally:
            target.close()

    def close(self) -> None:
        """Close all connections."""

        async def end() -> None:
            self._server.close()
            tasks = list(self._tasks)
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

        asyncio.run_coroutine_threadsafe(end(), self._loop).result(5)
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(5)

    def __enter__(self) -> SlowNetwork:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
