"""Addresses in object stores: s3://bucket/folder."""

import re
from pathlib import Path, PosixPath

from v3studio.studio.errors import StudioError

PACKAGES = {"s3": "s3fs", "gs": "gcsfs", "gcs": "gcsfs", "az": "adlfs", "abfs": "adlfs", "abfss": "adlfs"}
"""Kinds of addresses, and the package that reads them."""

CREDENTIALS = "contains credentials (a colon before an @, or a query)"
CREDENTIALS_FIX = "Leave them out and set them in the environment, such as AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY."
"""The text of messages about such an address. They never repeat it."""

_SCHEME = re.compile(r"([A-Za-z][A-Za-z0-9+.-]+):/+")


def is_address(path: Path | str) -> bool:
    """Return whether this is an address (s3://bucket/folder) rather than a path; pathlib joins its slashes
    (s3:/bucket)."""
    return _SCHEME.match(str(path)) is not None


def has_credentials(path: Path | str) -> bool:
    """Return whether this is an address that may contain credentials: a colon before an @, or a query (?sig=...).

    Anywhere in it, not only before the first slash: AWS's secrets may contain slashes.
    """
    scheme = _SCHEME.match(str(path))
    rest = str(path)[scheme.end() :] if scheme else ""
    return "?" in rest or ":" in rest.rpartition("@")[0]


class StoreAddress(PosixPath):
    """An address where a path is expected, such as in `CaptureSettings.root`.

    Its text is the address. No file has such a name, so anyone who takes it for one finds nothing.
    """

    def __str__(self) -> str:
        return _SCHEME.sub(r"\1://", super().__str__(), count=1)

    def __fspath__(self) -> str:
        return str(self)


def checked(path: Path | str) -> StoreAddress:
    """The address in a path or text; StudioError: an unknown kind (`storage.unknown_kind`), no bucket
    (`storage.no_bucket_named`), or credentials in it (`storage.credentials_in_address`), which are not repeated."""
    address = StoreAddress(str(path))
    scheme, _, rest = str(address).partition("://")
    if has_credentials(path):
        problem = f"the address ({scheme}://...) {CREDENTIALS}"
        raise StudioError("storage.credentials_in_address", problem, fix=CREDENTIALS_FIX)
    if scheme not in PACKAGES:
        fix = "Use s3://, gs:// or az://, or a folder."
        raise StudioError("storage.unknown_kind", f"unknown kind of address {scheme}://", file=address, fix=fix)
    # of s3:///folder, pathlib would take the first folder for the bucket
    if rest.startswith("/") or not rest or str(path).partition("://")[2].startswith("/"):
        fix = "Example: s3://bucket/folder."
        raise StudioError("storage.no_bucket_named", "the address names no bucket", file=str(path), fix=fix)
    return address
