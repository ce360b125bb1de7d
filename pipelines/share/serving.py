"""Serving streams and the browser player: `serve` for scripts, and what the command `v3studio serve` runs."""

from __future__ import annotations

import os
import secrets
import socket
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote

from v3studio.pipelines.share.addresses import is_local, own_names, reachable_hosts
from v3studio.pipelines.share.certificates import Certificate, make_certificate
from v3studio.pipelines.share.page import PageText
from v3studio.pipelines.share.player_files import PlayerFiles, read_player
from v3studio.pipelines.share.served import find_reviews, find_streams
from v3studio.pipelines.share.server import BoundedServer, listen
from v3studio.pipelines.share.web_app import Reviews, build_app
from v3studio.studio.errors import StudioError

_SECRET_BYTES = 16  # of the random part of secret links


class Serving:
    """A server that listens, in a thread of this process once it is started; also a context manager that closes it.

    Attributes:
        server: what listens; may be asked to exit.
        streams: folders of the streams by the address of their page, which ends in "/". The manifest is `manifest.json`
            below it; `StreamReader.open` and `v3studio play` take the address itself.
        reviews: folders of the takes that can be reviewed, by secret addresses.
        bases: addresses of the server, the one to try first at the beginning; with the secret part, if there is one.
        is_secret: whether they have one.
        is_local: whether only this machine can reach it.
        certificate: None over http.
    """

    def __init__(
        self,
        folder: str,
        host: str,
        port: int,
        player: PlayerFiles | None,
        *,
        https: bool = False,
        certificate: Certificate | None = None,
        token: bool | None = None,
        review: bool = False,
        allow_hosts: Sequence[str] = (),
        allow_origins: Sequence[str] = (),
        text: PageText | None = None,
        **options: Any,
    ) -> None:
        """Listen for `serve` or for the command, which run the server in a thread or in the main thread; StudioError as
        `serve`, and for nothing to review (`serve.nothing_to_review`).

        `player` None: serve the streams alone; `certificate` None: make one if `https`; `review`: serve reviews below
        another secret path, too; `text`: title (of a single stream) and intro of the pages.
        """
        streams = find_streams(folder)
        if text is not None and text.title is not None and len(streams) > 1:
            problem = f"--title is for one stream, but {folder} has {len(streams)}"
            fix = "Serve one of them, or leave the option out."
            raise StudioError("command.invalid_option", problem, value=text.title, fix=fix, option="--title")
        reviews = Reviews(secrets.token_urlsafe(_SECRET_BYTES), find_reviews(streams)) if review else None
        self.is_local = is_local(host)
        self.is_secret = not self.is_local if token is None else token
        secret = secrets.token_urlsafe(_SECRET_BYTES) if self.is_secret else ""
        hosts = reachable_hosts(host)
        if https and certificate is None:
            certificate = make_certificate(sorted({*hosts, socket.gethostname(), "localhost", "127.0.0.1", "::1"}))
        self.certificate = certificate
        names = (*own_names(), *allow_hosts)
        app = build_app(streams, player, reviews, secret, names, allow_origins, text)
        self.server = BoundedServer(app, certificate, **options)
        self._sock = listen(host, port)
        scheme = "http" if certificate is None else "https"
        roots = [f"{scheme}://{name}:{self._sock.getsockname()[1]}" for name in hosts]
        self.bases = tuple(f"{root}/{secret}".rstrip("/") for root in roots)
        self.streams = {_page(self.bases[0], path): folder for path, folder in streams.items()}
        self.reviews: dict[str, Path] = {}
        if reviews is not None:
            base = f"{roots[0]}/{reviews.secret}"
            self.reviews = {_page(base, path): streams[path].parent for path in reviews.takes}
        self._thread = threading.Thread(target=self.run, name="v3studio serve", daemon=True)

    @property
    def address(self) -> str:
        """Address of the first stream's page."""
        return next(iter(self.streams))

    @property
    def fingerprint(self) -> str | None:
        """SHA-256 of the certificate as browsers show it, "AB:CD:..."; None over http."""
        return None if self.certificate is None else self.certificate.fingerprint

    def run(self) -> None:
        """Serve in this thread until the server is asked to exit."""
        self.server.run(sockets=[self._sock])

    def start(self) -> Serving:
        """Serve in another thread; returns itself."""
        self._thread.start()
        return self

    def close(self) -> None:
        """Stop serving and free the port; may be called again."""
        self.server.should_exit = True
        if self._thread.is_alive():
            self._thread.join()
        self._sock.close()

    def __enter__(self) -> Serving:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


def _page(base: str, path: str) -> str:
    """Address of the page of a stream at a path."""
    return f"{base}{quote(path.rstrip('/'))}/"


def serve(
    folder: str | os.PathLike[str],
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
        >>> with v3.serve("my-take") as serving, v3.StreamReader.open(serving.address) as reader:
        ...     reader.frame_count
        5

    Args:
        folder: of a stream or a take, or a folder of several.
        host: address to bind to; "0.0.0.0" for other machines.
        port: 0 to 65535; 0 for any free port.
        https: encrypt with a certificate that is made for this server; browsers warn of it, compare `fingerprint`.
        token: whether to serve below a secret path that is part of the addresses; None: if other machines can reach
            the server.
        allow_hosts: further names of this machine in links, such as "example.org".
        allow_origins: pages that may read the streams and show their pages in a frame, such as "https://example.org",
            or "*" for all.

    Returns:
        The server, which accepts connections until it is closed, at the latest until the process ends.

    Raises:
        StudioError: no stream in the folder (`serve.no_stream`, `serve.not_a_folder`, `take.no_stream`), a port or a
            host that cannot be used (`command.invalid_option`, `serve.port_in_use`, `serve.unknown_host`,
            `serve.cannot_bind`), or a source checkout without the built player (`share.no_player`).
    """
    return Serving(
        os.fspath(folder),
        host,
        port,
        read_player(),
        https=https,
        token=token,
        allow_hosts=allow_hosts,
        allow_origins=allow_origins,
        log_config=None,  # the script's own logging stays as it is
    ).start()
