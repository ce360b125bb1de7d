"""The addresses to which a web server may send a reader."""

import ipaddress
import socket
from urllib.parse import urljoin, urlsplit

from v3studio.studio.errors import StudioError

MOST_REDIRECTS = 5
_PORTS = {"http": 80, "https": 443}


def redirected(url: str, location: str, name: str) -> str:
    """The address that an answer to `url` points to. Only what the server wrote is used, so that a query of ours stays.
    StudioError (`source.unsafe_redirect`): not http(s), from https to http, or from a public to a private network."""
    here = urlsplit(url)
    try:
        target = urljoin(url, location)
        there = urlsplit(target)
        _ = there.port
    except ValueError:
        raise _refused(name, "which is not an address") from None
    if there.scheme not in _PORTS or not there.hostname:
        raise _refused(name, "which is not http")
    if here.scheme == "https" and there.scheme == "http":
        raise _refused(name, "without encryption")
    if there.hostname != here.hostname and _is_private(there.hostname) and not _is_private(here.hostname or ""):
        raise _refused(name, "in a private network")
    return target


def same_origin(one: str, other: str) -> bool:
    """Return whether scheme, host and port are the same: only there, credentials are sent again."""
    first, second = urlsplit(one), urlsplit(other)
    return (first.scheme, first.hostname, first.port or _PORTS.get(first.scheme)) == (
        second.scheme,
        second.hostname,
        second.port or _PORTS.get(second.scheme),
    )


def _is_private(host: str) -> bool:
    """Return whether a host has an address that is not a public one."""
    try:
        addresses = [str(entry[4][0]) for entry in socket.getaddrinfo(host, None, type=socket.SOCK_STREAM)]
    except (OSError, UnicodeError):
        return False
    return any(not ipaddress.ip_address(address.partition("%")[0]).is_global for address in addresses)


def _refused(name: str, what: str) -> StudioError:
    fix = "If you trust it, use that address directly."
    return StudioError("source.unsafe_redirect", f"the server redirects to an address {what}", file=name, fix=fix)
