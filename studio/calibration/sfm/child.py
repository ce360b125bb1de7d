"""A child process that reports JSON lines, watched so that it can be stopped at any moment."""

from __future__ import annotations

import json
import os
import queue
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from typing import Any

from studio.errors import StudioError


def run_reporting(
    module: str, arguments: Sequence[str], on_line: Callable[[dict[str, Any]], None], *, what: str, tick: float = 0.2
) -> None:
    """Run `python -m module arguments` until it ends, handing over every JSON line it prints.

    Args:
        module: what to run, in this interpreter and with this import path.
        arguments: for it.
        on_line: called with each line, and every `tick` seconds with an empty dict while there is none; may raise
            (`Cancelled`, say): the child is then killed before the exception passes on.
        what: the work, for messages.
        tick: seconds.

    Raises:
        StudioError: the child reported an error, or died; the end of its standard error is quoted.
    """
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    child = subprocess.Popen(
        [sys.executable, "-m", module, *arguments],
        stdin=subprocess.PIPE,  # never written to: its closing tells the child that we are gone
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        env=environment,
        start_new_session=True,  # Ctrl-C reaches us alone; we stop the child
    )
    lines: queue.Queue[str | None] = queue.Queue()
    errors: list[str] = []
    assert child.stdout is not None
    assert child.stderr is not None

    def pump(stream: Any, put: Callable[[str], object]) -> None:
        for raw in stream:
            put(raw.decode("utf-8", "replace"))

    def pump_out() -> None:
        pump(child.stdout, lines.put)
        lines.put(None)

    def keep(line: str) -> None:
        errors.append(line.strip())
        del errors[:-20]

    threads = [
        threading.Thread(target=pump_out, daemon=True),
        threading.Thread(target=pump, args=(child.stderr, keep), daemon=True),
    ]
    for thread in threads:
        thread.start()
    finished, failure = False, ""
    try:
        while True:
            try:
                line = lines.get(timeout=tick)
            except queue.Empty:
                on_line({})
                continue
            if line is None:
                break
            try:
                values = json.loads(line)
            except (ValueError, RecursionError):
                continue  # native code may print on its own
            if not isinstance(values, dict):
                continue
            if values.get("finished"):
                finished = True
            elif "error" in values:
                failure = str(values["error"])
            else:
                on_line(values)
        child.wait()
    finally:
        if child.poll() is None:
            child.kill()
            child.wait()
        for thread in threads:
            thread.join(timeout=2)
        for stream in (child.stdin, child.stdout, child.stderr):
            if stream is not None:
                stream.close()
    if failure:
        raise StudioError(f"{what} failed: {failure.rstrip('.')}.")
    if not finished or child.returncode != 0:
        tail = " / ".join(line for line in errors[-3:] if line) or "it said nothing"
        raise StudioError(f"{what} ended unexpectedly (exit code {child.returncode}): {tail}.")
