"""Certificates for `v3studio serve --https`: given, or made for the occasion."""

import datetime
import hashlib
import ssl
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from v3studio.studio.errors import StudioError, reason_of

_VALID = datetime.timedelta(days=90)  # browsers refuse certificates that are valid for years
_BEGIN, _END = "-----BEGIN CERTIFICATE-----", "-----END CERTIFICATE-----"


@dataclass(frozen=True)
class Certificate:
    """A server's certificate, and its SHA-256 as browsers show it, for example "AB:CD:...". `made` by
    `make_certificate`: browsers warn of it, and the fingerprint tells that it is the right one."""

    context: ssl.SSLContext
    fingerprint: str
    made: bool


def load_certificate(certificate: Path, key: Path | None) -> Certificate:
    """A certificate and its chain from PEM files; its key, without a password, may be in the same one."""
    context = _context()
    try:
        text = certificate.read_text(encoding="ascii", errors="replace")
        context.load_cert_chain(certificate, key, password="")
        first = ssl.PEM_cert_to_DER_cert(text[text.index(_BEGIN) : text.index(_END) + len(_END)])
    except (OSError, ValueError) as error:  # ssl.SSLError is an OSError
        problem = f"not a certificate with its private key ({reason_of(error)})"
        fix = "Specify PEM files with --certificate and --key, the key without a password."
        raise StudioError("serve.bad_certificate", problem, file=certificate, fix=fix, key=key) from error
    return Certificate(context, _fingerprint(first), made=False)


def make_certificate(hosts: Sequence[str]) -> Certificate:
    """A certificate for host names and addresses, signed by an authority that is forgotten at once."""
    import trustme

    end = datetime.datetime.now(datetime.UTC) + _VALID
    # brackets belong to URLs, not to addresses
    leaf = trustme.CA(organization_name="V3 Studio").issue_cert(*(host.strip("[]") for host in hosts), not_after=end)
    context = _context()
    leaf.configure_cert(context)
    der = ssl.PEM_cert_to_DER_cert(leaf.cert_chain_pems[0].bytes().decode("ascii"))
    return Certificate(context, _fingerprint(der), made=True)


def _context() -> ssl.SSLContext:
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.set_alpn_protocols(["http/1.1"])
    return context


def _fingerprint(der: bytes) -> str:
    return ":".join(f"{byte:02X}" for byte in hashlib.sha256(der).digest())
