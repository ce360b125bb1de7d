"""The real window, driven from within: it opens one path after the other, and tells what it said of each.

    python tests/support/driven_window.py PATHS RESULTS

PATHS is a JSON list of folders and files; a JSON line per path is appended to RESULTS, as `Shown` describes it.
"""

import json
import os
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

STAGES = ("capture", "calibrate", "initialize", "train", "bake", "review")
SETTLED = 120.0
"""Seconds in which a view must have drawn its picture, or have said why it has none, on a busy machine."""


@dataclass(frozen=True)
class Shown:
    """What the window showed of a path.

    Attributes:
        path: the path.
        opened: whether it was opened.
        sentences: what the window said: over the viewport, in the status line, in the left panel, by stage.
        dialog: name of the dialog that came up; "" if none did.
        unsettled: views that drew nothing in time.
    """

    path: str
    opened: bool
    sentences: tuple[str, ...]
    dialog: str
    unsettled: tuple[str, ...]


def drive(display: str, paths: Sequence[Path], folder: Path, patience: float = 300.0) -> tuple[list[Shown], str, int]:
    """Let a window show all paths.

    Args:
        display: the X server.
        paths: what to open.
        folder: for the window's files.
        patience: seconds without a result after which the window hangs.

    Returns:
        What it showed, its standard error, and its exit status; the status is that of SIGKILL if it hung.
    """
    from tests.support.warm_python import warm_python

    folder.mkdir(parents=True, exist_ok=True)
    asked, told, errors = folder / "paths.json", folder / "shown.jsonl", folder / "window.stderr"
    asked.write_text(json.dumps([str(path) for path in paths]))
    told.write_text("")
    environment = {**os.environ, "DISPLAY": display, "XDG_CONFIG_HOME": str(folder), "XDG_STATE_HOME": str(folder)}
    environment.pop("WAYLAND_DISPLAY", None)
    with errors.open("wb") as output:
        process = warm_python().popen((__file__, asked, told), env=environment, output=output)
    size, since = 0, time.monotonic()
    while process.poll() is None:
        if told.stat().st_size > size:
            size, since = told.stat().st_size, time.monotonic()
        if time.monotonic() - since > patience:
            process.kill()
        time.sleep(0.05)
    rows = [json.loads(line) for line in told.read_text().splitlines()]
    shown = [Shown(**{**row, "sentences": tuple(row["sentences"])}) for row in rows]
    return shown, errors.read_text(errors="replace"), process.wait()


def main(paths: Path, results: Path) -> int:
    """The window."""
    from gui import app, window

    class DrivenWindow(window.MainWindow):
        """Goes through the paths as it ticks."""

        def _on_tick(self) -> bool:
            due = super()._on_tick()
            if not hasattr(self, "_script"):
                self._script = self._all()
            if next(self._script, "end") == "end":
                self.wants_close = True
            return due

        def _all(self) -> Iterator[None]:
            for path in json.loads(paths.read_text()):
                print(f"== {path}", file=sys.stderr, flush=True)
                before = self.player.opened
                while self.notices.dismiss():
                    pass
                self.notices.clear("open")
                self.open(path)
                while self.workspace.opening:
                    yield
                said = [self.player.message, self.notices.text]
                opened, late = self.player.opened is not before, []
                self.player.transport.pause()  # while it plays, a slow view always has the next frame to draw
                for stage in STAGES if opened else ():
                    self.select(stage)
                    self.player.transport.seek(self.player.transport.last)
                    end, start = time.monotonic() + SETTLED, self.ticks
                    while self.ticks < start + 3 or not self.views.settled:
                        if time.monotonic() > end:
                            late.append(stage)
                            break
                        yield
                    said += [self.views.message, self.message.text]
                    said += [self.stages.error.text, *self.player.left_out]
                said += [words for row in self.workspace.rows() for words in (row.words, row.detail)]
                said.append(self.notices.text)  # what failed since
                texts = tuple(dict.fromkeys(filter(None, said)))
                row = Shown(path, opened, texts, self.dialogs.name, tuple(late))
                with results.open("a") as file:
                    file.write(json.dumps(asdict(row)) + "\n")
                if self.dialogs.name:
                    self.dialogs.escape()
                    yield

    window.MainWindow = DrivenWindow  # type: ignore[misc]
    return app.main(["--size", "640x480"])  # a software renderer takes time for each pixel


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), Path(sys.argv[2])))
