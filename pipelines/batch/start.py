"""Works through the queue in a process that outlives the one that starts it."""

from __future__ import annotations

import subprocess
from pathlib import Path

from pipelines.batch.queue_file import QueueFile
from pipelines.runs.launch import launch


def errors_of(queue: QueueFile) -> Path:
    """File beside the queue with the standard error of the program that works through it."""
    return queue.path.with_name(f".{queue.path.name}.errors")


def start_queue(queue: QueueFile) -> subprocess.Popen[bytes]:
    """Start `v3studio queue run`. Raises OSError if there is no room for its messages."""
    return launch(["queue", "run", "--queue", str(queue.path.absolute())], errors_of(queue))
