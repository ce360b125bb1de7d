"""Works through the queue, one take after the other, in this process or in one that outlives it."""

import contextlib
import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

from v3studio.pipelines.batch.queue_file import QueuedTake, QueueFile, now
from v3studio.pipelines.events import Event, Finished, read_line
from v3studio.pipelines.events.cancellation import EXIT_CANCELLED
from v3studio.pipelines.runs.launch import launch
from v3studio.pipelines.takes.take import Take
from v3studio.studio.errors import Cancelled, reason_of
from v3studio.studio.process import python_command, start


def run_command(entry: QueuedTake) -> list[str]:
    """`v3studio run` for a take, as a command."""
    config = [str(entry.config)] if entry.config is not None else []
    overrides = [f"--set={text}" for text in entry.overrides]
    return python_command("v3studio.pipelines.cli", "run", *config, "--take", str(entry.take), "--json", *overrides)


def run_queue(
    queue: QueueFile,
    starts: Callable[[QueuedTake], None],
    emit: Callable[[Event], None],
    ended: Callable[[QueuedTake], None],
    command: Callable[[QueuedTake], list[str]] = run_command,
    check: Callable[[], None] = lambda: None,
) -> tuple[int, int]:
    """Run all takes that wait, also those that are added meanwhile; returns how many were finished, and failed.

    Each take runs in a process of its own (`v3studio run`), so that nothing of one is left in memory for the next, and
    not even a crash stops the queue. An interrupted take (Cancelled: Ctrl-C or SIGTERM) waits again and resumes where
    it stopped. `check` is called before each take and often while one is waited for or runs; it may raise `Cancelled`.
    Python drops an exception that a signal's handler raises within a destructor; what the handler has noted is not
    lost.
    """
    done = failed = 0
    with queue.running():
        while (entry := queue.claim()) is not None:
            try:
                starts(entry)
                check()
                code, message = _run(entry, command(entry), emit, check)
                if code == EXIT_CANCELLED:  # somebody stopped this process alone
                    raise Cancelled
            except BaseException:
                queue.replace(entry.number, state="waiting")
                raise
            state = "done" if code == 0 else "failed"
            after = {"state": state, "finished": now(), "message": message}
            queue.replace(entry.number, **after)
            done, failed = done + (code == 0), failed + (code != 0)
            ended(entry.model_copy(update=after))
    return done, failed


def _run(
    entry: QueuedTake, command: list[str], emit: Callable[[Event], None], check: Callable[[], None]
) -> tuple[int, str]:
    """Exit code and message of one run."""
    try:
        # a run that outlived a killed queue, or that somebody started; then this one finds its results
        while Take(entry.take).running() is not None:
            time.sleep(0.5)
            check()
        process = start(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, cwd=entry.folder)
    except OSError as error:  # a network drive is gone: the others need not wait for it
        return 1, f"{error.filename or entry.take} cannot be read ({reason_of(error)})"
    message, last = "", ""
    with process:
        assert process.stdout is not None
        try:
            for line in process.stdout:
                check()
                event, text = read_line(line)
                last = text.strip() or last
                if isinstance(event, Finished):
                    message = event.message
                if event is not None:
                    emit(event)
        except BaseException:  # Ctrl-C: the run ends in order and keeps its finished work
            with contextlib.suppress(ProcessLookupError):
                process.send_signal(signal.SIGTERM)
            process.wait()
            raise
    code = process.returncode
    if code < 0:
        return code, f"the process was ended by {signal.Signals(-code).name}"
    return code, "" if code == 0 else message or last or f"exit code {code}"


def errors_of(queue: QueueFile) -> Path:
    """File beside the queue with the standard error of the program that works through it."""
    return queue.path.with_name(f".{queue.path.name}.errors")


def start_queue(queue: QueueFile) -> subprocess.Popen[bytes]:
    """Start `v3studio queue run`. Raises OSError if there is no room for its messages."""
    return launch(["queue", "run", "--queue", str(queue.path.absolute())], errors_of(queue))
