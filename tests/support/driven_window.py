"""The real window, driven from within: it opens one path after the other.

    python tests/support/driven_window.py PATHS RESULTS

PATHS is a JSON list of folders and files. A JSON line per path is appended to RESULTS: `path`; `opened`, whether it
was; `sentences`, what the window said over the viewport, in the status line and in the left panel, by stage; `dialog`,
the name of the one that came up; `unsettled`, the stages that drew nothing in time.
"""

import json
import sys
import time
from collections.abc import Iterator
from pathlib import Path

from v3studio.gui import app, window
from v3studio.gui.models.stage_rows import TITLES

SETTLED = 120.0
"""Seconds in which a view must have drawn its picture, or have said why it has none, on a busy machine."""

PATHS, RESULTS = Path(sys.argv[1]), Path(sys.argv[2])


class DrivenWindow(window.MainWindow):
    """Goes through the paths as it ticks."""

    def tick(self) -> bool:
        due = super().tick()
        if not hasattr(self, "_script"):
            self._script = self._all()
        if next(self._script, "end") == "end":
            self.close_requests.wanted = True
        return due

    def _all(self) -> Iterator[None]:
        for path in json.loads(PATHS.read_text()):
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
            for stage in TITLES if opened else ():
                self.views.select(stage)
                self.player.transport.seek(self.player.transport.last)
                end, start = time.monotonic() + SETTLED, self.ticks
                while self.ticks < start + 3 or not self.views.settled:
                    if time.monotonic() > end:
                        late.append(stage)
                        break
                    yield
                said += [
                    self.views.message,
                    self.panels.message.text,
                    self.panels.stages.error.text,
                    *self.player.left_out,
                ]
            said += [words for row in self.workspace.rows() for words in (row.words, row.detail)]
            said.append(self.notices.text)  # what failed since
            texts, dialog = list(dict.fromkeys(filter(None, said))), self.dialogs.name
            row = {"path": path, "opened": opened, "sentences": texts, "dialog": dialog, "unsettled": late}
            with RESULTS.open("a") as file:
                file.write(json.dumps(row) + "\n")
            if dialog:
                self.dialogs.on_escape()
                yield


window.MainWindow = DrivenWindow  # type: ignore[misc]
sys.exit(app.main(["--size", "640x480"]))  # a software renderer takes time for each pixel
