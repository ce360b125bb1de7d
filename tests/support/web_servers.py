"""Web servers in this process for tests of `v3studio serve`, and requests to them."""

import http.client
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import uvicorn
from starlette.applications import Starlette

from v3studio.pipelines.share.player_files import PlayerFiles
from v3studio.pipelines.share.server import listen

PLAYER = PlayerFiles(
    "<title>V3 Player</title><!-- v3:head --><!-- v3:player -->old<!-- /v3:player -->"
    '<script type="module" src="v3-player.js"></script>',
    b"export {};",
    b"review();",
    b"cast();",
    {"v3-first.js": b"import('./v3-rest-0.js');", "v3-rest-0.js": b"export {};"},
)
"""A player of a few bytes, with the places that a page fills in."""


@contextmanager
def running(app: Starlette) -> Iterator[int]:
    """A server in this process; its port."""
    with listen("127.0.0.1", 0) as sock:
        server = uvicorn.Server(uvicorn.Config(app, log_level="error", lifespan="off"))
        thread = threading.Thread(target=server.run, kwargs={"sockets": [sock]})
        thread.start()
        try:
            yield sock.getsockname()[1]
        finally:
            server.should_exit = True
            thread.join(10)


def ask(
    port: int, path: str, method: str = "GET", body: bytes | None = None, **headers: str
) -> tuple[int, dict[str, str], bytes]:
    """Status, headers by lower-case name, and body of an answer; the path is sent as it is."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=120)
    connection.putrequest(method, path, skip_accept_encoding=True)
    for name, value in headers.items():
        connection.putheader(name.replace("_", "-"), value)
    if body is not None:
        connection.putheader("Content-Length", str(len(body)))
    connection.endheaders(body)
    answer = connection.getresponse()
    content = answer.read()
    connection.close()
    return answer.status, {name.lower(): value for name, value in answer.getheaders()}, content
