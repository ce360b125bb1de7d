"""A take's folder: where each stage's results lie, and the lock that keeps two runs apart.

Layout::

    take.json                                   format version, what made it
    config.yaml                                 all settings, resolved
    calibrate/rig.json, report.json             cameras as in the footage (full size, with lens distortion)
    calibrate/points.ply                        sparse points, where the cameras were found from the footage
    initialize/group_000/mesh.ply, points.ply   visual hull and points of each group's keyframe; report.json
    train/group_000/frame_000000.safetensors    Gaussians of a frame (counted from 0 in the take); group.json
    stream/                                     the stream, and nothing else
    evaluation.json, report.html                what came out
    marks.json                                  frames that somebody marked, with notes; there only if somebody did
    .v3studio/                                  lock, records of what results were made from, work in progress
"""

from __future__ import annotations

import datetime
import fcntl
import json
import os
import shlex
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from pipelines.config.renamed import first_name, first_path
from pipelines.takes.atomic_files import read_json, remove, sweep_partial, write_json
from studio.errors import StudioError
from studio.paths import need_utf8

TAKE_FORMAT = 2
"""Version of this layout. Format 1 had other names (`pipelines.config.renamed`): it is read as it is, and brought to
this one when a run first holds it (`pipelines.takes.migration`)."""

READABLE = (1, TAKE_FORMAT)


@dataclass(frozen=True)
class Take:
    """Paths of one take. `open` and `create` check that the folder is one."""

    root: Path

    @classmethod
    def open(cls, root: Path) -> Take:
        """An existing take.

        Raises:
            StudioError: no take there, or one of another version.
        """
        root = root.absolute()
        need_utf8(root)
        command = f"`v3studio run CONFIG --take {shlex.quote(str(root))}`"
        if not root.is_dir():
            raise StudioError(f"{root}: there is no such folder; {command} makes a take.")
        if not (root / "take.json").is_file():
            hint = f"; if it was lost, {command} writes it anew" if _looks_like(root) else ""
            raise StudioError(f"{root} is not a take (it has no take.json); give the folder of a take{hint}.")
        found = read_json(root / "take.json")
        version = found.get("format") if isinstance(found, dict) else None
        if version not in READABLE:
            maker = found.get("created_by", "an unknown program") if isinstance(found, dict) else "an unknown program"
            raise StudioError(
                f"{root / 'take.json'}: format {version!r}, made by {maker}; this version reads "
                f"formats {' and '.join(map(str, READABLE))}: "
                "use the version that made it, or run into a new folder."
            )
        return cls(root)

    @classmethod
    def create(cls, root: Path) -> Take:
        """The take at `root`, made if there is none.

        Raises:
            StudioError: the folder holds something else, or a take of another version.
        """
        root = root.absolute()
        need_utf8(root)
        if (root / "take.json").exists():
            return cls.open(root)
        if root.exists() and not root.is_dir():
            raise StudioError(f"{root} is a file; give a folder for the take.")
        if root.is_dir() and not _looks_like(root) and any(path.name != ".v3studio" for path in root.iterdir()):
            raise StudioError(f"{root} is not empty and is not a take; give a new or empty folder.")
        write_json(
            root / "take.json",
            {
                "format": TAKE_FORMAT,
                "created_by": f"v3studio {program_version()}",
                "created": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
            },
        )
        return cls(root)

    @property
    def config(self) -> Path:
        """config.yaml: all settings of the last run, resolved."""
        return self.root / "config.yaml"

    @property
    def rig(self) -> Path:
        """calibrate/rig.json."""
        return self.root / "calibrate" / "rig.json"

    @property
    def calibration_report(self) -> Path:
        """calibrate/report.json."""
        return self.root / "calibrate" / "report.json"

    @property
    def calibration_points(self) -> Path:
        """calibrate/points.ply: sparse points, where the cameras were found from the footage."""
        return self.root / "calibrate" / "points.ply"

    def initialize_group(self, group: int) -> Path:
        """initialize/group_000: mesh.ply, points.ply, report.json."""
        return self.folder("initialize") / group_name(group)

    def folder(self, stage: str) -> Path:
        """A stage's folder of results."""
        return self._kept(self.root, stage)

    def file(self, name: str) -> Path:
        """A file by its path relative to the take, as it is called now."""
        path, first = self.root / name, self.root / first_path(name)
        return first if not path.exists() and first.exists() else path

    def _kept(self, folder: Path, stage: str, ending: str = "") -> Path:
        """`folder/stage`; in a take of format 1 what that was called."""
        path, first = folder / f"{stage}{ending}", folder / f"{first_name(stage)}{ending}"
        return first if first != path and not path.exists() and first.exists() else path

    def train_group(self, group: int) -> Path:
        """train/group_000: a frame_000000.safetensors a frame, group.json."""
        return self.root / "train" / group_name(group)

    def trained_frame(self, group: int, index: int) -> Path:
        """Gaussians of the frame `index`, counted from 0 in the take."""
        return self.train_group(group) / f"frame_{index:06d}.safetensors"

    def trained_files(self) -> tuple[list[Path], tuple[int, ...]]:
        """Trained frames in order, up to the first that is missing, and the first frame of each group."""
        files: list[Path] = []
        starts: list[int] = []
        while (path := self.trained_frame(len(starts), len(files))).is_file():
            group = len(starts)
            starts.append(len(files))
            while path.is_file():
                files.append(path)
                path = self.trained_frame(group, len(files))
        return files, tuple(starts)

    def keyframe_checkpoint(self, group: int) -> Path:
        """A keyframe in training; gone when it is trained."""
        return self.train_group(group) / "keyframe.checkpoint"

    def motion_network(self, group: int, index: int) -> Path:
        """The motion network of the frame `index`, kept while the frame after it may need it (motion_warm_start)."""
        return self.train_group(group) / f"motion_{index:06d}.safetensors"

    @property
    def stream(self) -> Path:
        """stream/: whole or not there."""
        return self.root / "stream"

    @property
    def evaluation(self) -> Path:
        """evaluation.json."""
        return self.root / "evaluation.json"

    @property
    def report(self) -> Path:
        """report.html, self-contained."""
        return self.root / "report.html"

    @property
    def marks(self) -> Path:
        """marks.json: frames that somebody marked, with notes."""
        return self.root / "marks.json"

    @property
    def private(self) -> Path:
        """.v3studio/."""
        return self.root / ".v3studio"

    @property
    def grouping(self) -> Path:
        """Where groups begin, if the footage was asked."""
        return self.folder("initialize") / "groups.json"

    def record(self, stage: str) -> Path:
        """What a stage's results were made from; there only when the stage is finished."""
        return self._kept(self.private / "stages", stage, ".json")

    def failure(self, stage: str) -> Path:
        """Why a stage's last attempt failed; there only if it did."""
        return self._kept(self.private / "stages", stage, ".failed.json")

    def work(self, stage: str) -> Path:
        """A stage's folder for work in progress."""
        return self._kept(self.private / "work", stage)

    @property
    def footage_cache(self) -> Path:
        """Mattes and backgrounds that were slow to make. Its files are never out of date, and may be deleted."""
        return self.private / "footage"

    @property
    def previews(self) -> Path:
        """Pictures shown while training."""
        return self.private / "previews"

    @property
    def log(self) -> Path:
        """The events of the last run, a JSON object a line."""
        return self.private / "events.jsonl"

    @contextmanager
    def locked(self, command: str) -> Iterator[None]:
        """Hold the take for this process; leftovers of killed runs are swept away first.

        The kernel gives the lock back when a process dies, however it dies.

        Raises:
            StudioError: another run holds it.
        """
        self.private.mkdir(parents=True, exist_ok=True)
        path = self.private / "lock"
        with path.open("a+") as file:
            if not _lock_soon(file):
                holder = self.running() or {}
                raise StudioError(
                    f"Another run works on {self.root} (process {holder.get('pid', 'unknown')}, "
                    f"{holder.get('command', 'v3studio')}); wait for it or stop it."
                )
            file.seek(0)
            file.truncate()
            json.dump({"pid": os.getpid(), "command": command}, file)
            file.flush()
            try:
                sweep_partial(self.root)
                yield
            finally:
                file.seek(0)
                file.truncate()

    def running(self) -> dict[str, object] | None:
        """Process id and command of the run that holds the take, or None."""
        path = self.private / "lock"
        try:
            with path.open("r") as file:
                try:
                    fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
                except BlockingIOError:
                    try:
                        holder = json.load(file)
                    except ValueError:  # just being written
                        holder = {}
                    return dict(holder)
                return None
        except FileNotFoundError:
            return None

    def forget(self, stage: str) -> None:
        """Drop what is known of a stage, so that it runs again."""
        remove(self.record(stage))
        remove(self.failure(stage))


def _lock_soon(file: IO[str]) -> bool:
    """Whether the lock is ours; `status` holds it for a moment, so a few attempts are made."""
    for attempt in range(5):
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return True
        except BlockingIOError:
            if attempt < 4:
                time.sleep(0.05)
    return False


def group_name(group: int) -> str:
    """group_000."""
    return f"group_{group:03d}"


def program_version() -> str:
    """Version of the installed package, or "unknown" in a bare checkout."""
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version("v3studio")
    except PackageNotFoundError:
        return "unknown"


def _looks_like(root: Path) -> bool:
    """A take that has lost its take.json: its settings and some stage's results are there."""
    return (root / "config.yaml").is_file() and any((root / name).is_dir() for name in ("calibrate", "train", "stream"))
