"""Minutes and bytes of the presets for the open take on this machine, as `v3studio estimate` measures them."""

import contextlib
import hashlib
import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from v3studio.gui.models.loop import Signal
from v3studio.gui.models.take.jobs import Commands
from v3studio.gui.models.take.workspace import modified
from v3studio.pipelines.config import Config
from v3studio.pipelines.config.presets import PRESETS
from v3studio.pipelines.events import Event, Finished, read_line
from v3studio.pipelines.reports.terminal import duration
from v3studio.pipelines.takes.take import Take, program_version
from v3studio.studio.atomic_files import write_text
from v3studio.studio.storage.cache import cache_folder

Figures = Mapping[str, tuple[float, int | None]]  # seconds, and bytes of the stream (None: not estimated), by preset


class Estimates(Commands):
    """The estimates of the presets. `stop` ends the measurement with the window.

    Signals:
        changed: there are other figures, or none.
    """

    def __init__(self) -> None:
        super().__init__()
        self.changed: Signal[[]] = Signal()
        self.figures: Figures = {}
        self.failure = ""
        self._end: Finished | None = None
        self._of: tuple[Path | None, Config | None] = (None, None)
        self._path: Path | None = None
        self._measures: Path | None = None

    def words(self, preset: str) -> str:
        """ "preview: about 4 min, 1.2 MB"; only the name if nothing is known."""
        figures = self.figures.get(preset)
        if figures is None:
            return preset
        seconds, size = figures
        words = f"{preset}: about {duration(seconds)}"
        return words if size is None else f"{words}, {size / 1e6:.1f} MB"

    def start(self, take: Take) -> None:
        """Measure, unless a measurement is in progress. It takes about a minute and all cores."""
        if self.running or self._path is None:
            return
        self._end, self.failure, self._measures = None, "", self._path
        self._run(["estimate", str(take.root), "--presets", "--json"])
        self.changed.emit()

    def _told(self, events: Sequence[Event], status: int | None, error: str) -> None:
        self._end = next((event for event in events if isinstance(event, Finished)), self._end)
        if status is None:
            return
        if status == 0 and self._measures is not None:
            figures = _figures(self._end)
            if self._end is None or not figures:
                self.failure = "The estimate cannot be read."
            else:
                with contextlib.suppress(OSError):  # without a cache it is measured again next time
                    self._measures.parent.mkdir(parents=True, exist_ok=True)
                    write_text(self._measures, self._end.to_json())
            if self._measures == self._path:
                self.figures = figures
        elif status != 0:
            self.failure = error
        self.changed.emit()

    def show(self, take: Take | None, config: Config | None) -> bool:
        """Read the cached figures of another take or of other settings of the footage; whether they are others."""
        of = (take.root if take is not None else None, config)
        if of == self._of:
            return False
        self._of = of
        path = _cache_file(take, config) if take is not None and config is not None else None
        if path == self._path:
            return False
        self._path, self.figures = path, {}
        if path is not None:
            with contextlib.suppress(OSError):
                self.figures = _figures(read_line(path.read_text(encoding="utf-8"))[0])
        return True


def _cache_file(take: Take, config: Config) -> Path:
    """Its name has everything that the figures depend on, apart from the load of the machine."""
    unset = {name.partition(".")[2] for name in PRESETS["standard"]}  # set by the presets
    depends = [
        str(take.root.resolve()), modified(take.rig), os.cpu_count(), program_version(), PRESETS,
        config.capture.model_dump(mode="json"), config.initialize.model_dump(mode="json", exclude=unset),
        config.train.model_dump(mode="json", exclude=unset), config.bake.model_dump(mode="json", exclude=unset),
        config.evaluate.model_dump(mode="json"), config.run.model_dump(mode="json"),
    ]  # fmt: skip
    # of this machine: not kept in the take
    name = f"{hashlib.sha256(json.dumps(depends, sort_keys=True).encode()).hexdigest()[:32]}.json"
    return cache_folder() / "estimates" / name


def _figures(end: Event | None) -> Figures:
    """Figures of the command's last event; empty if it is damaged."""
    figures: dict[str, tuple[float, int | None]] = {}
    result: Any = end.result if isinstance(end, Finished) else {}
    with contextlib.suppress(ValueError, KeyError, TypeError, AttributeError):
        for name, estimate in result["presets"].items():
            stream = next((stage["bytes"] for stage in estimate["stages"] if stage["stage"] == "bake"), None)
            figures[str(name)] = (float(estimate["seconds"]), None if stream is None else int(stream))
    return figures
