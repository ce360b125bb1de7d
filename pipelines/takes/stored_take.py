"""Takes in object storage: a working copy on this machine, and what has changed in it or in the store since.

Stages read and write the working copy. `pull` brings it up to date, `push` sends what is new. Objects appear in a store
whole or not at all; records of what is finished are sent last and deleted first, so that whoever finds a record finds
what it tells of. Several machines may work on different groups of a take. Only one may run it
(`pipelines.takes.stored_run`).
"""

from __future__ import annotations

import json
import os
import re
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager, suppress
from pathlib import Path
from typing import NamedTuple, TypeVar

from studio.atomic_files import PARTIAL, write_bytes, write_json
from studio.errors import StudioError
from studio.storage import Entry, Store
from studio.storage.address import checked
from studio.storage.cache import cache_folder, locked

PUSH_SECONDS = 2.0
"""Seconds between two looks for new results while a stage works."""

NO_GROUP = -1
"""For `StoredTake.pull`: nothing of any group."""

_PRIVATE = ".v3studio"
_HERE_ONLY = re.compile(
    rf"{re.escape(_PRIVATE)}/"
    r"((lock|[a-z]+\.lock|cancel|events\.jsonl|store\.json|holder\.json|(background|window_job)\.log)$"
    r"|groups/|footage/|previews/|log/)"
)
"""Files of one machine: locks, logs, and what can be made again. `stored_run` sends the log of a run itself."""

_RECORD = re.compile(rf"{re.escape(_PRIVATE)}/stages/|bakes/[^/]+/bake\.json$")
"""Files that say that others are finished."""

_GROUP = re.compile(r"(?:^|/)group_(\d+)(?:[/._]|$)")
_PARALLEL = 8

Given = TypeVar("Given")
Made = TypeVar("Made")


class _Synced(NamedTuple):
    """A file when it was last the same here and in the store: size, time of change in ns, and the store's tag."""

    size: int
    changed: int
    tag: str


class StoredTake:
    """A take in object storage.

    Args:
        address: s3://bucket/folder of the take.

    Attributes:
        folder: the working copy, in the machine's cache folder.

    Raises:
        StudioError: the address cannot be used (`storage.*`).
    """

    def __init__(self, address: str | os.PathLike[str]) -> None:
        self.address = str(checked(os.fspath(address)))
        self.store = Store(self.address)
        self.folder = cache_folder() / "takes" / self.address.replace("://", "/")

    def pull(self, group: int | None = None) -> bool:
        """Bring the working copy up to date. What only the working copy has stays.

        Args:
            group: fetch nothing of other groups; `NO_GROUP`: of any; None: fetch everything.

        Returns:
            whether there is a take, here or in the store.

        Raises:
            StudioError: `storage.*`.
        """

        def wanted(name: str) -> bool:
            if PARTIAL in name or _HERE_ONLY.match(name) or any(part in ("", ".", "..") for part in name.split("/")):
                return False
            if group is not None and name.startswith("bakes/"):  # kept under names: no worker needs them
                return False
            found = _GROUP.search(name)
            return group is None or found is None or int(found[1]) == group

        with self._locked():
            synced = self._synced()
            there = {name: entry for name, entry in self.store.list().items() if wanted(name)}
            todo = [name for name, entry in there.items() if name not in synced or synced[name].tag != entry.tag]

            def fetch(name: str) -> tuple[str, _Synced]:
                entry = there[name]
                write_bytes(self.folder / name, self.store.read(name, 0, entry.size))
                return name, self._state(name, entry)

            try:
                for name, state in _in_parallel(fetch, todo):
                    synced[name] = state
                for name in [name for name in synced if wanted(name) and name not in there]:
                    if self._is_as(name, synced.pop(name)):
                        (self.folder / name).unlink()
            finally:
                self._write_synced(synced)
        return (self.folder / "take.json").is_file()

    def push(self) -> int:
        """Send what is new or changed in the working copy, and delete what was deleted there.

        Returns:
            number of files sent.

        Raises:
            StudioError: `storage.*`; what was not sent is sent the next time.
        """
        with self._locked():
            synced = self._synced()
            gone = [name for name in synced if not (self.folder / name).is_file()]
            new = [name for name in self._names() if not (name in synced and self._is_as(name, synced[name]))]

            def send(name: str) -> tuple[str, _Synced] | None:
                path = self.folder / name
                try:
                    before = path.stat()
                    data = path.read_bytes()
                except FileNotFoundError:  # deleted meanwhile
                    return None
                self.store.write(name, data)
                entry = self.store.entry(name) or Entry(len(data), "")
                return name, _Synced(before.st_size, before.st_mtime_ns, entry.tag)

            sent = 0
            try:
                for name in (name for name in gone if _kind(name) == 2):
                    self.store.delete(name)
                    del synced[name]
                for kind in (0, 1, 2):
                    for done in _in_parallel(send, [name for name in new if _kind(name) == kind]):
                        if done is not None:
                            synced[done[0]] = done[1]
                            sent += 1
                for name in (name for name in gone if name in synced):
                    self.store.delete(name)
                    del synced[name]
            finally:
                self._write_synced(synced)
        return sent

    @contextmanager
    def pushed(self) -> Iterator[None]:
        """Send what is new every few seconds during the block, and at its end, however it ends.

        Raises:
            StudioError: at the end, if the store does not take it (`storage.*`); it stays in the working copy.
        """
        try:
            with repeating(self.push, PUSH_SECONDS, "push"):  # a failure is reported at the end, unless that succeeds
                yield
        finally:
            self.push()

    def _locked(self) -> AbstractContextManager[bool]:
        return locked(self.folder / _PRIVATE / "sync.lock")

    def _names(self) -> list[str]:
        found = []
        for folder, _, files in os.walk(self.folder):
            for file in files:
                name = Path(folder, file).relative_to(self.folder).as_posix()
                if PARTIAL not in name and not _HERE_ONLY.match(name):
                    found.append(name)
        return sorted(found)

    def _state(self, name: str, entry: Entry) -> _Synced:
        state = (self.folder / name).stat()
        return _Synced(state.st_size, state.st_mtime_ns, entry.tag)

    def _is_as(self, name: str, synced: _Synced) -> bool:
        try:
            state = (self.folder / name).stat()
        except FileNotFoundError:
            return False
        return (state.st_size, state.st_mtime_ns) == (synced.size, synced.changed)

    def _synced(self) -> dict[str, _Synced]:
        try:
            found = json.loads((self.folder / _PRIVATE / "store.json").read_text())
            return {name: _Synced(*values) for name, values in found["synced"].items()}
        except (OSError, ValueError, KeyError, TypeError):
            return {}

    def _write_synced(self, synced: dict[str, _Synced]) -> None:
        write_json(self.folder / _PRIVATE / "store.json", {"address": self.address, "synced": synced})


def stored_take(folder: Path) -> StoredTake | None:
    """The take whose working copy on this machine is this folder; None for other folders."""
    try:
        address = str(json.loads((folder / _PRIVATE / "store.json").read_text())["address"])
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return StoredTake(address)


def _kind(name: str) -> int:
    """Order in which files are sent: 0 content, 1 JSON that tells of it, 2 records of stages and kept bakes."""
    return 2 if _RECORD.match(name) else int(name.endswith(".json"))


def _in_parallel(work: Callable[[Given], Made], items: list[Given]) -> Iterator[Made]:
    with ThreadPoolExecutor(_PARALLEL, thread_name_prefix="store") as pool:
        try:
            yield from pool.map(work, items)
        except BaseException:
            pool.shutdown(wait=True, cancel_futures=True)
            raise


@contextmanager
def repeating(action: Callable[[], object], seconds: float, name: str) -> Iterator[None]:
    """Within the block, a thread of this name calls `action` every so many seconds; its failures are ignored."""
    over = threading.Event()

    def repeat() -> None:
        while not over.wait(seconds):
            with suppress(StudioError, OSError):
                action()

    thread = threading.Thread(target=repeat, name=name, daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()
