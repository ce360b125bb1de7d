"""Serves streams and the browser player from a script, as `v3studio serve` does from the command line."""

from __future__ import annotations

import secrets
import socket
import threading
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING
from urllib.parse import quote

if TYPE_CHECKING:
    from pipelines.share.certificates import Certificate
    from pipelines.share.server import BoundedServer

_SECRET_BYTES = 16  # of the random part of secret links


class Serving:
    """A running server in a thread of this process; also a context manager that closes it. `serve` makes it.

    Attributes:
        streams: folders of the streams by the address of their page, which ends in "/". The manifest is `manifest.json`
            below it; `StreamReader.open` and `v3studio play` take the address itself.
        bases: addresses of the server, the one to try first at the beginning; with the secret part, if there is one.
        fingerprint: SHA-256 of the certificate as browsers show it, "AB:CD:..."; None over http.
    """

    def __init__(
        self,
        server: BoundedServer,
        sock: socket.socket,
        streams: dict[str, Path],
        bases: tuple[str, ...],
        fingerprint: str | None,
    ) -> None:
        self.streams = streams
        self.bases = bases
        self.fingerprint = fingerprint
        self._server, self._sock = server, sock
        self._thread = threading.Thread(
            target=server.run, kwargs={"sockets": [sock]}, name="v3studio serve", daemon=True
        )
        self._thread.start()

    @property
    def address(self) -> str:
        """Address of the first stream's page."""
        return next(iter(self.streams))

    def close(self) -> None:
        """Stop serving and free the port; may be called again."""
        self._server.should_exit = True
        self._thread.join()
        self._sock.close()

    def __enter__(self) -> Serving:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def serve(
    folder: Path | str,
    host: str = "127.0.0.1",
    port: int = 0,
    *,
    https: bool = False,
    token: bool | None = None,
    allow_hosts: Sequence[str] = (),
    allow_origins: Sequence[str] = (),
) -> Serving:
    """Serve a stream, the stream of a take, or all streams and takes in a folder, and the page that plays them.

    Example:
        with v3studio.serve("my-take") as serving:
            print(serving.address)
            input("Press Enter to stop.")

    Args:
        folder: of a stream or a take, or a folder of several.
        host: address to bind to; "0.0.0.0" for other machines.
        port: 0 to 65535; 0 for any free port.
        https: encrypt with a certificate that is made for this server; browsers warn of it, compare `fingerprint`.
        token: whether to serve below a secret path that is part of the addresses; None: if other machines can reach
            the server.
        allow_hosts: further names of this machine in links, such as "example.org".
        allow_origins: pages that may read the streams, such as "https://example.org", or "*" for all.

    Returns:
        The server, which accepts connections until it is closed, at the latest until the process ends.

    Raises:
        StudioError: no stream in the folder (`serve.no_stream`, `serve.not_a_folder`, `take.no_stream`), a port or a
            host that cannot be used (`command.invalid_option`, `serve.port_in_use`, `serve.unknown_host`,
            `serve.cannot_bind`), or a source checkout without the built player (`share.no_player`).
    """
    from pipelines.share.addresses import is_local, reachable_hosts
    from pipelines.share.host_check import own_names
    from pipelines.share.listening import listen
    from pipelines.share.player_files import read_player
    from pipelines.share.served_streams import find_streams
    from pipelines.share.server import BoundedServer, server_config
    from pipelines.share.web_app import build_app

    streams = find_streams(str(folder))
    player = read_player()
    secret = secrets.token_urlsafe(_SECRET_BYTES) if (not is_local(host) if token is None else token) else ""
    hosts = reachable_hosts(host)
    certificate = _certificate(hosts) if https else None
    sock = listen(host, port)
    try:
        root = [f"http{'s' * https}://{name}:{sock.getsockname()[1]}" for name in hosts]
        bases = tuple(f"{address}/{secret}".rstrip("/") for address in root)
        app = build_app(streams, player, None, secret, (*own_names(), *allow_hosts), allow_origins)
        # the script's own logging stays as it is
        config = server_config(app, certificate, log_config=None)
        pages = {f"{bases[0]}{quote(path.rstrip('/'))}/": stream for path, stream in streams.items()}
        fingerprint = None if certificate is None else certificate.fingerprint
        return Serving(BoundedServer(config), sock, pages, bases, fingerprint)
    except BaseException:
        sock.close()
        raise


def _certificate(hosts: Sequence[str]) -> Certificate:
    from pipelines.share.certificates import make_certificate

    return make_certificate(sorted({*hosts, socket.gethostname(), "localhost", "127.0.0.1", "::1"}))
