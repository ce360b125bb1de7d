"""Runs a child process that prints JSON lines and can be stopped at any time."""

import json
import logging
import os
import queue
import subprocess
import tempfile
import threading
from collections.abc import Callable, Sequence

from v3studio.studio.errors import Message, StudioError
from v3studio.studio.process import python_command, start

_LOG = logging.getLogger(__name__)


def run_reporting(module: str, arguments: Sequence[str], on_progress: Callable[[str, int, int], None]) -> None:
    """Run `python -m module arguments` to completion and pass on the progress that it prints as JSON lines.

    Args:
        module: the module to run, with this interpreter.
        on_progress: called with `step`, `done` and `total` of each line, and with "", 0 and 0 every 0.2 s without one.
            If it raises (for example `Cancelled`), the child is killed before the exception passes on.

    Raises:
        StudioError: as printed by the child (`error`, the fields of its message), or calibration.worker_died.
    """
    with (
        tempfile.TemporaryFile() as errors,
        start(
            python_command(module, *arguments),
            stdin=subprocess.PIPE,  # never written to; when it closes, the child ends
            stdout=subprocess.PIPE,
            stderr=errors,
            start_new_session=True,  # Ctrl-C must not reach the child: this process stops it
        ) as child,
    ):
        lines: queue.Queue[bytes | None] = queue.Queue()

        def pump() -> None:
            for line in child.stdout or ():
                lines.put(line)
            lines.put(None)

        thread = threading.Thread(target=pump, daemon=True)
        thread.start()
        failure, step = None, ""
        try:
            while True:
                try:
                    line = lines.get(timeout=0.2)
                except queue.Empty:
                    on_progress("", 0, 0)
                    continue
                if line is None:
                    break
                try:
                    message = json.loads(line)
                except (ValueError, RecursionError):
                    continue  # native code also prints
                if isinstance(message, dict) and "error" in message:
                    failure = Message(**message["error"])
                elif isinstance(message, dict):
                    if message["step"] != step:
                        step = message["step"]
                        _LOG.debug("process %d: %s", child.pid, step)
                    on_progress(message["step"], message["done"], message["total"])
            child.wait()
            _LOG.debug("process %d ended with exit code %d", child.pid, child.returncode)
        finally:
            if child.poll() is None:
                child.kill()
            thread.join(timeout=2)
        errors.seek(max(0, errors.seek(0, os.SEEK_END) - 65_536))
        last = [line.strip() for line in errors.read().decode("utf-8", "replace").splitlines()[-3:]]
    if failure is not None:
        raise StudioError.of(failure)
    if child.returncode != 0:
        tail = " / ".join(filter(None, last))
        problem = (
            f"Structure from motion ended unexpectedly with exit code {child.returncode}: {tail or 'no error output'}"
        )
        fix = "If memory ran out, close other programs, or reduce calibrate.frame_count."
        raise StudioError(
            "calibration.worker_died", problem, value=child.returncode, fix=fix, exit_code=child.returncode, stderr=tail
        )
