"""Listening sockets."""

from __future__ import annotations

import errno
import socket

from studio.errors import StudioError


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
