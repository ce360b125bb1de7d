"""Starts `v3studio` as a process that outlives the one that starts it."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

_ROOT = Path(__file__).resolve().parents[2]


def launch(words: Sequence[str], errors: Path) -> subprocess.Popen[bytes]:
    """Start `v3studio WORDS` in a session of its own; standard error goes to a file."""
    path = os.pathsep.join(filter(None, [str(_ROOT), os.environ.get("PYTHONPATH")]))
    with errors.open("wb") as file:
        return subprocess.Popen(
            [sys.executable, "-m", "pipelines.cli", *words],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=file,
            start_new_session=True,
            env={**os.environ, "PYTHONPATH": path},
        )
