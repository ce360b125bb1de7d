"""Card: what the start page tells about a recent take or stream. Reads files: use on a worker thread."""

import contextlib
import datetime
import os
import time
from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum
from functools import lru_cache
from pathlib import Path

from v3studio.gui.drawing.palette import State
from v3studio.gui.models.stages import STAGES
from v3studio.gui.models.take.doubts import doubts
from v3studio.pipelines.config import load_config
from v3studio.pipelines.runs import runner
from v3studio.pipelines.runs.staleness import StageStatus
from v3studio.pipelines.runs.status import progress
from v3studio.pipelines.takes.results.evaluation import read_evaluation
from v3studio.pipelines.takes.take import Take
from v3studio.studio.comparison.metrics import MAIN
from v3studio.studio.counts import listed, size_words
from v3studio.studio.errors import StudioError
from v3studio.studio.stream import is_address

MEASURE_EVERY = 60.0
"""Seconds between two measurements of the size of a take that is running: all its files are looked at, and a new size
of its stream makes a new image."""


class CardKind(StrEnum):
    """The kind of a recent place."""

    TAKE = "take"
    STREAM = "stream"
    WEB = "web"  # a stream with a URL
    MISSING = "missing"
    DAMAGED = "damaged"
    UNKNOWN = "unknown"  # not read yet


@dataclass(frozen=True)
class Card:
    """A recent take or stream."""

    place: str
    kind: CardKind
    words: str = ""  # how far it is, or what is wrong with it
    state: State = State.MISSING
    changed: float | None = None  # when its results or settings last changed, seconds since 1970; None if unknown
    quality: float | None = None  # of the decoded stream, in the unit of `MAIN`; None if it was not measured
    stream_bytes: int | None = None  # size of the stream; None if there is none, or if it is on another machine
    total_bytes: int | None = None  # size of the folder; None as above

    @property
    def name(self) -> str:
        return self.place.rstrip("/").rsplit("/", 1)[-1] or self.place

    @property
    def folder(self) -> str:
        """The folder that it is in, with "~" for the home folder."""
        if self.kind == CardKind.WEB:
            return self.place
        parent, home = str(Path(self.place).parent), str(Path.home())
        return "~" + parent[len(home) :] if parent == home or parent.startswith(home + "/") else parent

    @property
    def sizes(self) -> str:
        """ "stream 930.0 KB of 214.0 MB", as far as they are known."""
        stream = "" if self.stream_bytes is None else f"stream {size_words(self.stream_bytes)}"
        total = "" if self.total_bytes is None or self.kind != CardKind.TAKE else size_words(self.total_bytes)
        return " of ".join(filter(None, (stream, total)))


def date_words(when: float | None) -> str:
    """ "2026-03-03" in local time; "" for None and for what is no date."""
    try:
        return "" if when is None else f"{datetime.datetime.fromtimestamp(when):%Y-%m-%d}"
    except (OverflowError, ValueError, OSError):  # a file's time can be anything
        return ""


def describe(place: str) -> Card:
    """Read what a card shows. Of a URL nothing is fetched."""
    if is_address(place):
        return Card(place, CardKind.WEB, "stream on the web")
    path = Path(place)
    if not path.exists():
        return Card(place, CardKind.MISSING, "missing: moved or deleted", State.FAILED)
    if (path / "take.json").is_file():
        try:
            return _take(Take.open(path))
        except StudioError as error:
            return Card(place, CardKind.DAMAGED, str(error.message.problem), State.FAILED, _newest([path]))
    if (path / "manifest.json").is_file() or path.suffix.lower() == ".v3s":
        size = folder_bytes(path)
        return Card(
            place, CardKind.STREAM, "stream", State.DONE, _newest([path, path / "manifest.json"]), None, size, size
        )
    return Card(place, CardKind.DAMAGED, "neither a take nor a stream any more", State.FAILED, _newest([path]))


def _take(take: Take) -> Card:
    changed = _newest([take.config, take.log, take.stream / "manifest.json", take.evaluation, take.private / "stages"])
    running, now = take.running() is not None, time.monotonic()
    sizes = _sizes(take, now // MEASURE_EVERY if running else now)
    quality = None
    with contextlib.suppress(StudioError):
        if take.evaluation.is_file():
            quality = read_evaluation(take.evaluation).summary.measures.get(f"{MAIN.name}_decoded")
    if running:
        return Card(str(take.root), CardKind.TAKE, progress(take)[0], State.RUNNING, changed, quality, *sizes)
    try:
        words, state = state_words(runner.status(take, load_config(take.config)))
    except StudioError as error:
        words, state = error.problem, State.FAILED
    return Card(str(take.root), CardKind.TAKE, words, state, changed, quality, *sizes)


@lru_cache(maxsize=100)
def _sizes(take: Take, _when: float) -> tuple[int | None, int]:
    """Bytes of the stream and of everything, measured once for each value of `_when`."""
    return folder_bytes(take.stream) if take.has_stream else None, folder_bytes(take.root)


def state_words(stages: dict[str, StageStatus]) -> tuple[str, State]:
    """A take's state, in words too. `stages`: as printed by `v3studio status`."""
    by_title = {stage.title: stages[stage.name] for stage in STAGES if stage.name in stages}
    for state in (State.FAILED, State.STALE):
        titles = [title for title, status in by_title.items() if status.state == state]
        if titles:
            return f"{listed(titles)} {state}", state
    done = [title for title, status in by_title.items() if status.state == State.DONE]
    if len(done) == len(by_title):
        told = doubts([warning for status in by_title.values() for warning in status.warnings])
        return (told[0], State.STALE) if told else ("all stages done", State.DONE)
    for title, status in by_title.items():
        if status.state == State.PARTIAL:
            return f"{title}: {status.units_done} of {status.units} {status.unit}", State.STALE
    following = next(title for title in by_title if title not in done)
    return (f"next: {following}" if done else "not started"), State.MISSING


def folder_bytes(path: Path) -> int:
    """Size of a file, or of all files in a folder, bytes; links are not followed."""
    if path.is_file():
        return path.stat().st_size
    total = 0
    for folder, _, names in os.walk(path):
        for name in names:
            with contextlib.suppress(OSError):  # it is being changed: the rest still counts
                total += os.lstat(os.path.join(folder, name)).st_size
    return total


def fingerprint(place: str) -> tuple[object, ...]:
    """Changes with everything that a card depends on, except the progress of a run."""
    path = Path(place)
    names = (
        "take.json", "config.yaml", "edits.json", "evaluation.json", "manifest.json", "stream", "stream/manifest.json",
        ".v3studio", ".v3studio/stages", ".v3studio/events.jsonl",
    )  # fmt: skip
    return (path.exists(), *(_newest([path / name]) for name in names))


def _newest(paths: Iterable[Path]) -> float | None:
    times = []
    for path in paths:
        with contextlib.suppress(OSError):
            times.append(path.stat().st_mtime)
    return max(times, default=None)
