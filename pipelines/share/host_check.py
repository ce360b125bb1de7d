"""Answers only requests that are meant for this server, by their Host header.

Otherwise a page on the web whose name its owner lets point to this machine (DNS rebinding) could read what is served.
"""

import ipaddress
import socket
from collections.abc import Iterable

from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Receive, Scope, Send


def own_names() -> tuple[str, ...]:
    """Names by which other machines may know this one."""
    name = socket.gethostname().lower()
    return (name, f"{name.partition('.')[0]}.local")


def is_allowed(host: str, names: Iterable[str]) -> bool:
    """Whether a Host header names this server: an IP address, localhost, or one of the names.

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


class HostCheck:
    """ASGI middleware: 421 for other hosts."""

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
