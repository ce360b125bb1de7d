"""The queue of takes in the window, which runs it: a failed take does not stop the next one."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

from pipelines.batch.queue_file import QueueFile
from tests.support.waiting import wait_until

ROWS = 12


def test_takes_are_lined_up_and_run(
    open_window: Callable[..., Any], take_copy: Path, tmp_path: Path, artifacts: Path
) -> None:
    queue = QueueFile(tmp_path / "state" / "v3studio" / "queue.json")
    gone, broken = tmp_path / "gone", tmp_path / "broken"
    shutil.copytree(take_copy, broken, ignore=shutil.ignore_patterns("train", "stream", "initialize"))
    settings = (broken / "config.yaml").read_text()
    (broken / "config.yaml").write_text(settings.replace("  root: ", "  root: /nowhere"))
    queue.add(gone, None, ())
    queue.add(broken, None, ())

    def shown(*rows: str) -> None:
        """Wait until the list shows these rows; each begins with the given text."""
        window.wait_for(
            f"{rows}",
            lambda s: len(s["lines"]) == len(rows) and all(map(str.startswith, s["lines"], rows)),
            240,
        )

    def choose(row: int) -> None:
        window.click("dialog list", 0.2, 0.011 + (row + 0.5) / ROWS)

    window = open_window(str(take_copy))
    window.wait_for("the take", lambda s: s["frames"] > 1)
    window.key("q")
    shown("1   gone   waiting", "2   broken   waiting")
    window.click("dialog add_open")
    shown("1   gone   waiting", "2   broken   waiting", "3   take   waiting")
    choose(0)
    window.click("dialog remove")
    shown("2   broken   waiting", "3   take   waiting")
    choose(1)
    window.click("dialog up")
    shown("3   take   waiting", "2   broken   waiting")
    window.click("dialog down")
    shown("2   broken   waiting", "3   take   waiting")
    window.click("dialog start")
    shown("2   broken   failed", "3   take   done")
    wait_until("the end of the program", lambda: not queue.is_run())
    window.drawn()
    window.screenshot(artifacts / "dialog_queue.png")
    choose(0)
    window.click("dialog retry")
    shown("3   take   done", "2   broken   waiting")
    window.click("dialog close")
    window.wait_for("no dialog", lambda s: s["dialog"] == "")
    assert window.close() == 0, window.stderr.read_text()[-2000:]
