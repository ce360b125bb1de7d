"""Reads and writes objects of a store: failed requests are repeated, and errors say what to do."""

import os
import re
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

from v3studio.studio.errors import StudioError, reason_of
from v3studio.studio.storage.address import PACKAGES, checked

ATTEMPTS = 4
"""How often a request is made before it counts as failed. fsspec's file systems repeat some requests themselves."""

FIRST_PAUSE = 0.25  # seconds before the second attempt; each further pause is twice as long

_TAGS = ("ETag", "etag", "md5Hash", "generation", "content_md5", "LastModified", "last_modified", "updated", "mtime")
"""Keys under which file systems give the version of an object; the first that is present is used."""

_SECRETS = re.compile(r"(SECRET|TOKEN|PASSWORD|ACCOUNT_KEY|CONNECTION_STRING)", re.IGNORECASE)
_SIGNED = re.compile(r"(?i)\b(sig|signature|x-amz-[a-z-]+|accountkey|sharedaccesssignature|token)=[^&\s;'\"]+")
_DENIED = re.compile(
    r"accessdenied|forbidden|\b40[13]\b|signaturedoesnotmatch|invalidaccesskeyid|unauthorized", re.IGNORECASE
)
_MISSING = re.compile(r"nosuchbucket|containernotfound|\b404\b", re.IGNORECASE)
_CREDENTIALS = re.compile(r"credential|connection_string", re.IGNORECASE)

Found = TypeVar("Found")


@dataclass(frozen=True)
class Entry:
    """An object in a listing. `size`: in bytes."""

    size: int
    tag: str


class Store:
    """A folder in an object store (s3://bucket/folder, gs://..., az://...); credentials: environment. Thread safe."""

    def __init__(self, address: str | os.PathLike[str]) -> None:
        self.address = str(checked(os.fspath(address)))
        scheme = self.address.partition("://")[0]
        try:
            from fsspec.core import url_to_fs

            self._files, root = url_to_fs(self.address, use_listings_cache=False)
        except ImportError as error:
            problem = f"a package is missing ({error})"
            fix = f"Install it: pip install {PACKAGES[scheme]}."
            raise StudioError("storage.missing_package", problem, file=self.address, fix=fix) from None
        except Exception as error:  # each file system raises its own
            raise self._failed("reached", "", error) from None
        self._root = root.rstrip("/")

    def list(self) -> dict[str, Entry]:
        """Paths of all objects in the folder to their entries."""

        def find() -> Mapping[str, Any]:
            try:
                entries: Mapping[str, Any] = self._files.find(self._root, detail=True, withdirs=False)
            except FileNotFoundError as error:
                if re.search("bucket|container", self._without_names(str(error), ""), re.IGNORECASE):
                    raise
                return {}
            return entries

        entries = self._repeated("listed", "", find)
        return {
            name.removeprefix(self._root).lstrip("/"): _entry(about)
            for name, about in entries.items()
            if about.get("type", "file") == "file" and not name.endswith("/")
        }

    def read(self, path: str, start: int, stop: int) -> bytes:
        """Bytes start to stop (exclusive) of an object; StudioError `storage.*`, also if all attempts get too few."""

        def get() -> bytes:
            data: bytes = self._files.cat_file(f"{self._root}/{path}", start=start, end=stop)
            if len(data) != stop - start:
                raise OSError("only a part arrived")
            return data

        return self._repeated("read", path, get) if stop > start else b""

    def write(self, path: str, data: bytes, kind: str, cache: str) -> None:
        """Write an object, by its path in the store's folder; StudioError: `storage.*`. `kind`, `cache`: Content-Type
        and Cache-Control with which S3 serves it; other stores take no such options."""
        headers = {"CacheControl": cache, "ContentType": kind} if self.address.startswith("s3://") else {}
        self._repeated("written", path, lambda: self._files.pipe_file(f"{self._root}/{path}", data, **headers))

    def _repeated(self, what: str, path: str, request: Callable[[], Found]) -> Found:
        pause = FIRST_PAUSE
        for attempt in range(ATTEMPTS):
            try:
                return request()
            except Exception as error:  # each file system raises its own
                failed = self._failed(what, path, error)
                if failed.code != "storage.failed" or attempt == ATTEMPTS - 1:
                    raise failed from None
            time.sleep(pause)
            pause *= 2
        raise AssertionError("unreachable")

    def _without_names(self, text: str, path: str) -> str:
        """A text of the store without the bucket, folders and object, whose names may look like errors."""
        bucket, _, folder = self.address.partition("://")[2].partition("/")
        names = (self.address, f"{bucket}/{folder}", f"{folder}/{path}", folder, path, bucket)
        for name in sorted(filter(None, (name.strip("/") for name in names)), key=len, reverse=True):
            text = re.sub(rf"(?<![\w.-]){re.escape(name)}(?![\w-])", "", text)
        return text

    def _failed(self, what: str, path: str, error: Exception) -> StudioError:
        """The error of a file system, without credentials."""
        file = f"{self.address}/{path}" if path else self.address
        reason = without_secrets(f"{reason_of(error)}")
        text = self._without_names(f"{type(error).__name__} {error}", path)
        if _CREDENTIALS.search(text):
            problem = "there are no credentials for this store, or they are incomplete"
            fix = (
                "Set them in the environment of every machine, such as AWS_ACCESS_KEY_ID and "
                "AWS_SECRET_ACCESS_KEY for s3://."
            )
            return StudioError("storage.no_credentials", problem, file=file, fix=fix)
        if isinstance(error, PermissionError) or _DENIED.search(text):
            fix = f"Check the credentials in the environment, and that they may {_NEEDED[what]}."
            return StudioError("storage.denied", f"the store refuses access ({reason})", file=file, fix=fix)
        if isinstance(error, FileNotFoundError) or _MISSING.search(text):
            fix = "Create the bucket or correct the address; for a store other than AWS, set AWS_ENDPOINT_URL."
            return StudioError("storage.not_found", f"there is no such bucket or object ({reason})", file=file, fix=fix)
        problem = f"cannot be {what} after {ATTEMPTS} attempts ({reason})"
        fix = "Check the network and the store, and run again; finished work is kept."
        return StudioError("storage.failed", problem, file=file, fix=fix)


_NEEDED = {  # which permission each kind of request needs
    "reached": "list this bucket and read its objects",
    "listed": "list this bucket",
    "read": "read objects of this bucket",
    "written": "write objects of this bucket",
}


def without_secrets(text: str) -> str:
    """Text without signatures and without values of the environment's secret variables."""
    for name, value in os.environ.items():
        if _SECRETS.search(name) and len(value) >= 6:
            text = text.replace(value, "***")
    return _SIGNED.sub(r"\1=***", text)


def _entry(about: Mapping[str, Any]) -> Entry:
    tag = next((str(about[name]) for name in _TAGS if about.get(name)), "")
    return Entry(int(about.get("size") or about.get("Size") or 0), tag.strip('"'))
