"""Under which addresses other machines reach this one."""

from __future__ import annotations

import ipaddress
import socket

import psutil

ANY = ("", "0.0.0.0", "::")
"""Hosts that mean every interface."""

# reserved for documentation (RFC 5737 and 3849)
_ELSEWHERE = {socket.AF_INET: "192.0.2.1", socket.AF_INET6: "2001:db8::1"}


def reachable_hosts(host: str) -> list[str]:
    """Hosts to put into URLs for a server that is bound to `host`, the one to try first at the beginning.

    For every interface (`0.0.0.0`, `::`), the addresses of this machine's interfaces that are up, except loopback and
    link-local ones; the name of this machine where there are none. IPv6 addresses are in brackets.
    """
    if host not in ANY:
        return [_bracketed(host)]
    family = socket.AF_INET6 if host == "::" else socket.AF_INET
    up = {name for name, stats in psutil.net_if_stats().items() if stats.isup}
    found = []
    for name, addresses in psutil.net_if_addrs().items():
        for address in addresses:
            if name in up and address.family == family:
                plain = ipaddress.ip_address(address.address.partition("%")[0])
                if not (plain.is_loopback or plain.is_link_local):
                    found.append(str(plain))
    first = _route_address(family)
    found.sort(key=lambda address: address != first)  # stable: the others stay in order
    return [_bracketed(address) for address in found] or [socket.gethostname()]


def is_local(host: str) -> bool:
    """Whether a server that is bound to `host` can be reached from this machine only."""
    if host in ANY:
        return False
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost" or host.endswith(".localhost")


def _route_address(family: socket.AddressFamily) -> str | None:
    """Address of the interface that leads to other networks; None if none does. Nothing is sent."""
    try:
        with socket.socket(family, socket.SOCK_DGRAM) as probe:
            probe.connect((_ELSEWHERE[family], 9))
            return str(probe.getsockname()[0])
    except OSError:
        return None


def _bracketed(host: str) -> str:
    return f"[{host}]" if ":" in host else host
