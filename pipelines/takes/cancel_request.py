"""A request to cancel the run of a take, from any machine that sees its folder."""

import json
import os
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from v3studio.pipelines.takes.take import Take
from v3studio.studio.atomic_files import remove, write_text
from v3studio.studio.bounded_files import parse_json
from v3studio.studio.errors import StudioError, reason_of

_LOOK = 0.5  # seconds between two looks for a request


def request_cancel(take: Take) -> None:
    """Ask the run in progress to stop; it does within seconds, and keeps finished work.

    Nothing happens if no run is in progress.
    """
    holder = take.running()
    for _ in range(20):
        if holder is None:
            return
        if "pid" in holder:
            break
        time.sleep(0.05)  # a run that has just taken the lock writes who it is a moment later
        holder = take.running()
    if holder is None:
        return
    try:
        write_text(take.cancel_request, json.dumps({name: holder.get(name) for name in ("pid", "host")}))
    except OSError as error:
        problem = f"the request to stop the run cannot be written ({reason_of(error)})"
        fix = "Stop the run where it was started, or from a machine that can write to the take."
        raise StudioError("take.not_writable", problem, file=take.cancel_request, fix=fix) from error


@contextmanager
def cancelled_on_request(take: Take, cancel: Callable[[], None]) -> Iterator[None]:
    """Within the block, `cancel` is called from another thread when a request arrives.

    Requests to other runs are dropped. One to this run may already be there: the take is locked before this begins.
    """
    if not _asked(take):
        remove(take.cancel_request)
    over = threading.Event()

    def watch() -> None:
        while not over.wait(_LOOK):
            if _asked(take):
                cancel()
                return

    watcher = threading.Thread(target=watch, name="cancel requests", daemon=True)
    watcher.start()
    try:
        yield
    finally:
        over.set()
        watcher.join()
        remove(take.cancel_request)


def _asked(take: Take) -> bool:
    """Return whether this process is asked to stop."""
    try:
        asked = parse_json(take.cancel_request.read_bytes())
    except (OSError, ValueError):
        return False
    return isinstance(asked, dict) and (asked.get("pid"), asked.get("host")) == (
        os.getpid(),
        socket.gethostname(),
    )
