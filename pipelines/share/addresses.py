"""Finds the addresses under which other machines reach this one, and makes QR codes of them."""

import io
import ipaddress
import socket

import numpy as np
import psutil

ANY = ("", "0.0.0.0", "::")  # hosts that mean every interface

# reserved for documentation (RFC 5737 and 3849)
_ELSEWHERE = {socket.AF_INET: "192.0.2.1", socket.AF_INET6: "2001:db8::1"}


def reachable_hosts(host: str) -> list[str]:
    """Hosts to put into URLs for a server that is bound to `host`, the one to try first at the beginning; IPv6 in
    brackets. For every interface (`0.0.0.0`, `::`), the addresses of this machine's interfaces that are up, except
    loopback and link-local ones; the name of this machine where there are none."""
    if host not in ANY:
        return [_bracketed(host)]
    family = socket.AF_INET6 if host == "::" else socket.AF_INET
    up = {name for name, stats in psutil.net_if_stats().items() if stats.isup}
    usable: list[str] = []
    for name, addresses in psutil.net_if_addrs().items():
        for address in addresses:
            if name in up and address.family == family:
                plain = ipaddress.ip_address(address.address.partition("%")[0])
                if not (plain.is_loopback or plain.is_link_local):
                    usable.append(str(plain))
    first = route_address(family)
    usable.sort(key=lambda address: address != first)  # stable: the others stay in order
    return [_bracketed(address) for address in usable] or [socket.gethostname()]


def is_local(host: str) -> bool:
    """Return whether a server that is bound to `host` can be reached from this machine only."""
    if host in ANY:
        return False
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost" or host.endswith(".localhost")


def own_names() -> tuple[str, ...]:
    """Names by which other machines may know this one."""
    name = socket.gethostname().lower()
    return (name, f"{name.partition('.')[0]}.local")


def route_address(family: socket.AddressFamily) -> str | None:
    """Address of the interface that leads to other networks; None if none does. Nothing is sent."""
    try:
        with socket.socket(family, socket.SOCK_DGRAM) as probe:
            probe.connect((_ELSEWHERE[family], 9))
            return str(probe.getsockname()[0])
    except OSError:
        return None


def _bracketed(host: str) -> str:
    return f"[{host}]" if ":" in host else host


# QR codes

_QUIET = 4  # light modules around the code, which readers need
_ERROR_CORRECTION = "m"


def qr_text(address: str) -> str:
    """The code in half blocks for a terminal, white on black whatever colors the terminal has."""
    import segno

    out = io.StringIO()
    segno.make(address, error=_ERROR_CORRECTION, micro=False).terminal(out, border=_QUIET, compact=True)
    lines = out.getvalue().rstrip("\n").split("\n")
    return "\n".join(f"\x1b[97;40m{line}\x1b[0m" for line in lines)


def qr_pixels(address: str, size: int) -> np.ndarray:
    """The code, at most `size` pixels wide, with its margin: (H, W, 3) uint8, black on white; whole modules."""
    import segno

    code = segno.make(address, error=_ERROR_CORRECTION, micro=False)
    scale = max(size // code.symbol_size(border=_QUIET)[0], 1)
    dark = np.array([list(row) for row in code.matrix_iter(scale=scale, border=_QUIET)], bool)
    return np.repeat(np.where(dark, 0, 255).astype(np.uint8)[:, :, None], 3, axis=2)
