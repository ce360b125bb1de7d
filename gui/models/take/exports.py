"""Exports and shares: `v3studio export` and `v3studio share` as child processes, and the views of a camera path."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from v3studio.gui.models.camera_path import PathEditor
from v3studio.gui.models.loop import Signal
from v3studio.gui.models.playback.viewpoint import BACKGROUNDS
from v3studio.gui.models.take.jobs import Commands, scratch_folder
from v3studio.gui.models.take.shares import NamedTarget, ShareRequest
from v3studio.pipelines.events import Event, Finished, Log, Progress
from v3studio.pipelines.events.cancellation import EXIT_CANCELLED
from v3studio.pipelines.takes.authored.camera_paths import in_export
from v3studio.studio.counts import counted, size_words
from v3studio.studio.errors import StudioError
from v3studio.studio.formats import EXPORTS
from v3studio.studio.formats.camera_path import Key, write_path_keys

_FOLDERS = ("frame", "plates")
FORMATS = {form.name: (form.title, "" if form.holds in _FOLDERS else form.suffix) for form in EXPORTS.values()}
"""Export formats: label, and the file extension (none for folders)."""

ALL_FRAMES = "all"
WHOLE = tuple(form.name for form in EXPORTS.values() if form.follows_path or form.holds == "stream")
"""Formats that always have all frames, or those of their views."""

MOVIES = tuple(form.name for form in EXPORTS.values() if form.holds == "movie")
SIZED = tuple(form.name for form in EXPORTS.values() if form.holds in ("movie", "plates"))
MOVIE_SIZES = ("1280x720", "1920x1080", "720x1280", "1080x1080", "640x360")
MOVIE_BACKGROUNDS: dict[str, tuple[float, float, float] | None] = {"as captured": None, **BACKGROUNDS}
"""Background of the movie by label; None is the capture's own."""

LEAST_SECONDS = 6.0  # minimum default duration of a turntable in seconds; faster ones are dizzying


@dataclass
class ExportRequest(NamedTarget):
    """An export as specified in the dialog; text as typed."""

    kind: str  # a key of `FORMATS`
    source: str
    title: str
    folder: Path
    of: str = ""  # "decoded" or "trained"; "" for a bare stream
    # frames to choose from by label, as `v3studio export --frames` takes them; those of `ALL_FRAMES` are all
    ranges: Mapping[str, range | None] = field(default_factory=lambda: {ALL_FRAMES: None})
    frames: str = ALL_FRAMES
    # seconds, size, background: options of a movie, size of plates, too; from `MOVIE_SIZES` and `MOVIE_BACKGROUNDS`
    seconds: str = f"{LEAST_SECONDS:g}"
    size: str = MOVIE_SIZES[0]
    background: str = "as captured"
    _target: str = ""

    @property
    def format(self) -> str:
        """Label of the format."""
        return FORMATS[self.kind][0]

    @format.setter
    def format(self, label: str) -> None:
        self.kind = next(kind for kind, (name, _) in FORMATS.items() if name == label)

    @property
    def usual_name(self) -> str:
        """Named after the source and the options."""
        part = "" if self.chosen is None else f"-{self.frames.replace(' ', '-')}"
        suffix = EXPORTS[self.kind].suffix if self.chosen is not None and len(self.chosen) == 1 else ""
        return f"{self.title}-{self.of or 'stream'}-{self.kind}{part}{FORMATS[self.kind][1] or suffix}"

    @property
    def ending(self) -> str | None:
        return EXPORTS[self.kind].suffix if EXPORTS[self.kind].holds in ("movie", "stream") else None

    @property
    def chosen(self) -> range | None:
        """The chosen frames; None for all."""
        return None if self.kind in WHOLE else self.ranges[self.frames]

    def arguments(self) -> list[str]:
        """Arguments of `v3studio export`, without the camera path. Raises StudioError: `export.bad_seconds`."""
        arguments = [self.source, "--format", self.kind, "--out", str(self.path), "--json"]
        if self.of:
            arguments += ["--of", self.of]
        if self.kind in SIZED:
            arguments += ["--size", self.size]
        color = MOVIE_BACKGROUNDS[self.background]
        if color is not None and self.kind in MOVIES:
            arguments += ["--background", ",".join(f"{value:g}" for value in color)]
        if self.kind == "turntable":
            try:
                seconds = float(self.seconds)
            except ValueError:
                seconds = 0.0
            if not 0 < seconds <= 3600:
                problem = f"movie length '{self.seconds}' is not a number of seconds above 0 and at most 3600"
                raise StudioError("export.bad_seconds", problem, value=self.seconds, fix="Example: 6.")
            arguments += ["--seconds", f"{seconds:g}"]
        return arguments


class Exports(Commands):
    """Runs one export or share at a time.

    Signals:
        changed: there is more progress.
        finished: the export has ended; `result` and `failed` say how.
    """

    def __init__(self) -> None:
        super().__init__()
        self.path = PathEditor()
        self.shares: dict[tuple[str, str], ShareRequest] = {}  # the last ones, by form and source
        self.request: NamedTarget | None = None  # the last one that was started; None before the first
        self.progress = ""  # last report of progress; stays after the end
        self.result = ""  # outcome of the last one; "" while one is running
        self.failed = self._stopping = False
        self.written: Path | None = None  # what the last one wrote; None if it failed or was stopped
        self.changed: Signal[[]] = Signal()
        self.finished: Signal[[]] = Signal()
        self._notes = ""

    @property
    def does(self) -> str:
        """Return what the last one was, "export" or "share"."""
        return self.request.does.lower() if self.request is not None else "export"

    @property
    def words(self) -> str:
        """Progress of the running export; "" if none is running."""
        return self.progress if self.running else ""

    def start(self, request: ExportRequest) -> None:
        """Start an export; StudioError: `export.running`, `export.target_exists`, `export.too_few_views`,
        `export.bad_seconds`, views show frames that what is exported does not have (`export.frames_left_out`), or it
        cannot be read."""
        self._check_idle()
        if request.path.exists():
            raise StudioError(
                "export.target_exists", "already exists; existing files are never overwritten", file=request.path,
                fix="Choose another name.",
            )  # fmt: skip
        arguments = ["export", *request.arguments()]
        keys = self._keys(request) if EXPORTS[request.kind].follows_path else []
        frames = request.chosen
        scratch = scratch_folder()
        if keys:
            write_path_keys(keys, scratch / "path.json")
            arguments += ["--path", str(scratch / "path.json")]
        if frames is not None:
            arguments += ["--frames", f"{frames[0]}:{frames[-1] + 1}"]
        self._begin(request, arguments, scratch)

    def share(self, request: ShareRequest) -> None:
        """Begin to share. Raises StudioError: `export.running`."""
        self._check_idle()
        self._begin(request, ["share", *request.arguments()])

    def _check_idle(self) -> None:
        if self.running:
            fix = "Wait for it to finish, or stop it from the Export menu."
            raise StudioError("export.running", "another export is running", fix=fix)

    def _begin(self, request: NamedTarget, arguments: list[str], scratch: Path | None = None) -> None:
        self._run(arguments, scratch)
        self.request, self._target, self._stopping, self._notes = request, request.path, False, ""
        self.progress, self.result = f"{self.does}: starting", ""

    def _keys(self, request: ExportRequest) -> list[Key]:
        """The camera path, in the frames and the world of the export."""
        if len(self.path.keys) < 2:
            problem = "a camera path needs at least two views"
            fix = "Add views with K, then export again."
            raise StudioError("export.too_few_views", problem, value=len(self.path.keys), fix=fix)
        width, height = map(int, request.size.split("x"))
        return in_export(self.path.fitted_keys(width, height), request.source, request.of, self.path.numbers)

    def _told(self, events: Sequence[Event], status: int | None, error: str) -> None:
        request = self.request
        assert request is not None
        for event in events:
            if isinstance(event, Progress):
                self.progress = f"{event.label}: {event.figures.get('done')} of {event.figures.get('total')}"
            elif isinstance(event, Log):
                self._notes += f"\n{event.message[:1].upper()}{event.message[1:].rstrip('.')}."
            elif isinstance(event, Finished):
                size, files = event.result.get("total_bytes"), event.result.get("files")  # of a share
                if isinstance(size, int) and isinstance(files, int):
                    self._notes += f"\n{size_words(size)} in {counted(files, 'file')}"
        if status is None:
            self.changed.emit()
            return
        self.failed = status not in (0, EXIT_CANCELLED)
        self.written = self._target if status == 0 else None
        if status == 0:
            self.result = f"{request.done}: {self._target}{self._notes}"
        elif self._stopping or status == EXIT_CANCELLED:
            self.result, self.failed = f"{request.does} stopped. No files were left behind.", False
        else:
            self.result = f"{request.does} failed: {error}"
        self.finished.emit()

    def stop(self) -> None:
        """Stop the export; partial output is removed."""
        if self._process is not None:
            self._stopping = True
            self._process.cancel()
