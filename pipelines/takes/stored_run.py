"""The one run of a take in object storage: who has it, its log, and requests to cancel it, seen from every machine.

The machine of the run renews a claim in the store and sends the take's log there. Other machines copy both to their
working copy, where `Take.running` and the log tell what they tell of a run on this machine.
"""

from __future__ import annotations

import json
import os
import secrets
import socket
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from pipelines.takes.stored_take import StoredTake, repeating
from pipelines.takes.take import HOLDER_SECONDS, Take, own_claims
from studio.atomic_files import write_bytes, write_json
from studio.errors import StudioError

LOOK_SECONDS = 2.0
"""Seconds between two looks at the log and for requests, on the machine of the run and on those that follow it."""

RENEWED = 30.0
"""Seconds between two renewals of the claim."""

SEGMENT = 1 << 20
"""Bytes of the log in one object: only the last is written again as the log grows."""

_HOLDER = ".v3studio/holder.json"
_CANCEL = ".v3studio/cancel"
_LOGS = ".v3studio/log"


class StoredRun:
    """See the module.

    Args:
        stored: the take.

    Attributes:
        stored: the same.
    """

    def __init__(self, stored: StoredTake) -> None:
        self.stored, self._store = stored, stored.store
        self._take = Take(stored.folder)
        self._segments: dict[str, tuple[str, bytes]] = {}

    @contextmanager
    def held(self, command: str) -> Iterator[None]:
        """Claim the take for a run of this process, and send its log until the block ends.

        Args:
            command: what others are told.

        Raises:
            StudioError: a run on another machine has it (`take.locked`); or `storage.*`.
        """
        token = secrets.token_hex(8)
        mine = {"token": token, "host": socket.gethostname(), "pid": os.getpid(), "command": command}
        self.refuse_other()
        self._claim(mine)
        self.refuse_other(token)  # two began at once: the later claim holds
        self._take.holder.unlink(missing_ok=True)
        own_claims[self._take.holder] = token
        try:
            with self._kept_up(mine):
                yield
        finally:
            del own_claims[self._take.holder]

    @contextmanager
    def _kept_up(self, mine: Mapping[str, object]) -> Iterator[None]:
        """Renew the claim and send the log during the block; give the take free at its end."""
        for name in self._store.list(_LOGS):
            self._store.delete(name)
        sender = _LogSender(self._take.log, lambda number, data: self._store.write(_segment(mine, number), data))
        renewed = time.monotonic()

        def look() -> None:
            nonlocal renewed
            if time.monotonic() - renewed >= RENEWED:
                self._claim(mine)
                renewed = time.monotonic()
            self._obey(mine)
            sender.send()

        try:
            with repeating(look, LOOK_SECONDS, "claim"):
                yield
        finally:
            with suppress(StudioError):  # the claim expires
                sender.send()
                self._store.delete(_HOLDER)

    def refuse_other(self, token: str = "") -> None:
        """Raise if a run has the take.

        Args:
            token: of the claim that is ours.

        Raises:
            StudioError: `take.locked`; or `storage.*`.
        """
        holder = self._holder()
        if holder is None or holder.get("token") == token:
            return
        pid, command = holder.get("pid"), holder.get("command")
        raise StudioError(
            "take.locked",
            f"another run is in progress (process {pid} on {holder.get('host')}, {command})",
            file=self.stored.address,
            fix=f"`v3studio attach ADDRESS` shows it. If it was killed, the take is free after {HOLDER_SECONDS:.0f} s.",
            pid=pid,
            command=command,
        )

    def refresh(self) -> None:
        """Copy the claim and the log of a run on another machine to the working copy; once more when it has ended.

        Raises:
            StudioError: `storage.*`.
        """
        before = _parsed(self._take.holder)
        holder = self._holder()
        if self._take.lock_holder() is not None:  # this copy has the log of the run
            holder = before = None
        if (told := holder or before) is not None:
            self._fetch_log(str(told.get("token")))
        if holder is not None:
            write_json(self._take.holder, dict(holder))
        else:
            self._take.holder.unlink(missing_ok=True)

    @contextmanager
    def followed(self) -> Iterator[None]:
        """Keep the working copy's claim and log up to date during the block.

        Raises:
            StudioError: the first look fails (`storage.*`); later ones are repeated.
        """
        self.refresh()
        with repeating(self.refresh, LOOK_SECONDS, "follow"):
            yield

    def request_cancel(self) -> None:
        """Ask the run in progress to stop; nothing happens if there is none.

        Raises:
            StudioError: `storage.*`.
        """
        holder = self._holder()
        if holder is not None:
            self._store.write(_CANCEL, json.dumps({"token": holder.get("token")}).encode())

    def _claim(self, mine: Mapping[str, object]) -> None:
        self._store.write(_HOLDER, json.dumps({**mine, "renewed": time.time()}).encode())

    def _obey(self, mine: Mapping[str, object]) -> None:
        if (asked := self._read(_CANCEL)) is not None:
            if asked.get("token") == mine["token"]:
                write_json(self._take.cancel_request, {"pid": mine["pid"], "host": mine["host"]})
            self._store.delete(_CANCEL)

    def _holder(self) -> dict[str, object] | None:
        """The claim, unless it has expired or its process has ended."""
        found = self._read(_HOLDER)
        if found is None or not isinstance(found.get("pid"), int):
            return None
        renewed = found.get("renewed")
        if not isinstance(renewed, int | float) or time.time() - renewed > HOLDER_SECONDS:
            return None
        ended = found.get("host") == socket.gethostname() and not Path(f"/proc/{found['pid']}").exists()
        return None if ended else found

    def _read(self, name: str) -> dict[str, object] | None:
        entry = self._store.entry(name)
        if entry is None:
            return None
        try:
            found = json.loads(self._store.read(name, 0, entry.size))
        except ValueError:
            return None
        return found if isinstance(found, dict) else None

    def _fetch_log(self, token: str) -> None:
        names = self._store.list(f"{_LOGS}/{token}")
        for name, entry in names.items():
            if self._segments.get(name, ("", b""))[0] != entry.tag or not entry.tag:
                self._segments[name] = (entry.tag, self._store.read(name, 0, entry.size))
        whole = b"".join(self._segments[name][1] for name in sorted(names))
        log = self._take.log
        known = log.read_bytes() if log.is_file() else None
        if known is not None and known and whole.startswith(known):
            with log.open("ab") as file:  # whoever follows the log sees that it is the same one
                file.write(whole[len(known) :])
        elif whole:
            write_bytes(log, whole)


class _LogSender:
    """Sends what a log has grown by.

    Args:
        log: the file; what it has now is of an earlier run.
        write: writes a segment, by its number.
    """

    def __init__(self, log: Path, write: Callable[[int, bytes], None]) -> None:
        self._log, self._write = log, write
        self._earlier = _state(log)
        self._sent = 0

    def send(self) -> None:
        """Send what is new. Raises StudioError (`storage.*`)."""
        now = _state(self._log)
        if now is None or now == self._earlier:
            return
        self._earlier = None
        with self._log.open("rb") as file:
            first = self._sent // SEGMENT
            file.seek(first * SEGMENT)
            data = file.read()
        if first * SEGMENT + len(data) <= self._sent:
            return
        for number, start in enumerate(range(0, len(data), SEGMENT), first):
            self._write(number, data[start : start + SEGMENT])
            self._sent = number * SEGMENT + len(data[start : start + SEGMENT])


def _segment(mine: Mapping[str, object], number: int) -> str:
    return f"{_LOGS}/{mine['token']}/{number:06d}.jsonl"


def _state(path: Path) -> tuple[int, int] | None:
    try:
        found = path.stat()
    except FileNotFoundError:
        return None
    return found.st_ino, found.st_mtime_ns


def _parsed(path: Path) -> dict[str, object] | None:
    try:
        found = json.loads(path.read_bytes())
    except (OSError, ValueError):
        return None
    return found if isinstance(found, dict) else None
