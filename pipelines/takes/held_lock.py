"""A locked file that says which process holds it, so that others can name it and stop it."""

import contextlib
import fcntl
import json
import os
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from studio.bounded_files import parse_json
from studio.errors import StudioError


@contextmanager
def held(path: Path, refused: Callable[[dict[str, Any]], StudioError], **about: str) -> Iterator[None]:
    """Lock a file for this process, whose `pid` and `host` are written to it with `about`; the kernel releases it when
    the process ends for any reason. `refused`: what to raise if another one holds it, of what `holder_of` says."""
    with path.open("a") as file:
        for _ in range(5):  # who only asks whether it is locked holds it briefly
            with contextlib.suppress(BlockingIOError):
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            time.sleep(0.05)
        else:
            raise refused(holder_of(path) or {})
        file.truncate(0)
        file.write(json.dumps({"pid": os.getpid(), "host": socket.gethostname(), **about}))
        file.flush()
        try:
            yield
        finally:  # before the lock is released: the next process must never seem to be this one
            file.truncate(0)


def holder_of(path: Path) -> dict[str, Any] | None:
    """`pid`, `host` and what else the process that holds a lock says; {}: it has not said it yet; None: none does."""
    with contextlib.suppress(FileNotFoundError), path.open("r") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            with contextlib.suppress(ValueError):
                return dict(parse_json(file.read()))
            return {}
    return None
