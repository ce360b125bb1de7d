"""A take's folder: where everything is (docs/reference/take.md), and the lock against two runs at the same time."""

from __future__ import annotations

import datetime
import shlex
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from v3studio.pipelines.takes.files.json_files import Result, read_json, write_model
from v3studio.pipelines.takes.files.leftovers import sweep_partial
from v3studio.pipelines.takes.files.locks import held, holder_of
from v3studio.pipelines.version import program_version
from v3studio.studio.atomic_files import leftovers, lock, remove
from v3studio.studio.bounded_files import need_utf8
from v3studio.studio.errors import Message, StudioError
from v3studio.studio.json_types import JsonObject
from v3studio.studio.storage import StoreAddress, is_address

TAKE_FORMAT = 2  # version of this layout


class TakeFile(Result):
    """take.json."""

    format: Any  # `TAKE_FORMAT` of the version that wrote it
    created_by: str = "an unknown program"
    created: str = ""  # UTC, ISO 8601


class _At:
    """A file or folder of a take, by its path relative to it."""

    def __init__(self, path: str) -> None:
        self._path = path

    def __get__(self, take: Take, owner: type[Take]) -> Path:
        return take.root / self._path


@dataclass(frozen=True)
class Take:
    """The paths in a take, below its absolute folder. Use `open` or `create`, which check the folder."""

    root: Path
    config = _At("config.yaml")  # all settings of the last run
    rig = _At("calibrate/rig.json")
    calibration_report = _At("calibrate/report.json")
    calibration_points = _At("calibrate/points.ply")  # sparse points, if the cameras were calibrated from footage
    rig_verdict = _At("initialize/verdict.json")  # whether cameras, images and masks agree
    card = _At("initialize/card.json")  # what was measured of time, cameras, masks and color before training
    card_picture = _At("initialize/card.jpg")
    motion = _At("initialize/motion.json")  # how far the performer moves, which decides where groups begin
    set_splats = _At("set/splats.safetensors")  # the set behind the performer, in the take's own frame; may be absent
    set_report = _At("set/set.json")  # how well it shows the plates, or why there is no set
    camera_colors = _At("train/camera_colors.json")  # color matrices of the cameras, with train.camera_colors
    refined_rig = _At("train/rig.json")  # the cameras that were refined while training, if they are used
    camera_refinement = _At("train/refinement.json")  # what refining the cameras changed; exists if it was tried
    stream = _At("stream")
    bakes = _At("bakes")  # bakes that are kept under names
    evaluation = _At("evaluation.json")
    report = _At("report.html")  # self-contained
    marks = _At("marks.json")  # marked frames with notes
    camera_path = _At("camera_path.json")  # the camera path that was edited in the window
    edits = _At("edits.json")  # what is trimmed, cropped, removed and moved after training
    garbage = _At("garbage.yaml")  # garbage masks that were drawn in the window
    private = _At(".v3studio")
    footage_cache = _At(".v3studio/footage")
    """Cache of masks and background plates. Its files never become stale and may be deleted at any time."""
    previews = _At(".v3studio/previews")  # preview images rendered during training
    cancel_request = _At(".v3studio/cancel")  # exists while the run in progress is asked to stop
    group_events = _At(".v3studio/events")  # what the groups of a run on several machines report
    log = _At(".v3studio/events.jsonl")  # events of the last run, one JSON object per line

    def __fspath__(self) -> str:
        """The folder's path: a take can be passed wherever that can."""
        return str(self.root)

    @classmethod
    def open(cls, root: Path | str) -> Take:
        """Open an existing take; StudioError: an address in object storage (`take.needs_folder`), no such folder
        (`take.not_found`), no take.json (`take.not_a_take`, `take.is_stream`), another format (`take.unknown_format`),
        or a damaged take.json (`take.damaged`)."""
        root = _checked(root)
        command = f"`v3studio run CONFIG --take {shlex.quote(str(root))}`"
        if root.is_file():
            problem = "is a file, not a take"
            raise StudioError("take.not_a_take", problem, file=root, fix="Specify the folder of a take.", lost=False)
        if not root.is_dir():
            raise StudioError("take.not_found", "no such folder", file=root, fix=f"Create a take with {command}.")
        if not (root / "take.json").is_file():
            if (root / "manifest.json").is_file():
                problem = "is a stream, without the footage and cameras of a take"
                fix = "Specify the folder of a take; `v3studio play`, `serve`, `share` and `export` also take streams."
                raise StudioError("take.is_stream", problem, file=root, fix=fix)
            lost = _looks_like(root)
            fix = f"If take.json was lost, {command} writes a new one." if lost else "Specify the folder of a take."
            raise StudioError("take.not_a_take", "not a take: it has no take.json", file=root, fix=fix, lost=lost)
        content = read_json(root / "take.json")
        try:
            about = TakeFile.model_validate(content)
        except ValidationError:
            about = TakeFile(format=content.get("format") if isinstance(content, dict) else None)
        if about.format != TAKE_FORMAT:
            raise StudioError(
                "take.unknown_format",
                f"take format {about.format!r}, written by {about.created_by}; this version reads format {TAKE_FORMAT}",
                file=root / "take.json",
                value=about.format,
                fix="Use the version that wrote it, or choose a new folder.",
                created_by=about.created_by,
                expected=TAKE_FORMAT,
            )
        return cls(root)

    @classmethod
    def create(cls, root: Path | str) -> Take:
        """Open the take at `root`, or create one there; StudioError: a file (`take.is_file`), a folder of other files
        (`take.not_empty`), or as `open`."""
        root = _checked(root)
        if (root / "take.json").exists():
            return cls.open(root)
        if root.exists() and not root.is_dir():
            raise StudioError("take.is_file", "is a file, not a folder", file=root, fix="Specify a folder.")
        # a run that was killed as it created the take left no more than these
        ours = {root / ".v3studio", *leftovers(root, root / "take.json")}
        if root.is_dir() and not _looks_like(root) and any(path not in ours for path in root.iterdir()):
            fix = "Specify a new or an empty folder."
            raise StudioError("take.not_empty", "the folder is not empty and is not a take", file=root, fix=fix)
        about = TakeFile(
            format=TAKE_FORMAT,
            created_by=f"v3studio {program_version()}",
            created=datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        )
        write_model(root / "take.json", about, durable=True)
        return cls(root)

    @property
    def has_stream(self) -> bool:
        """Tell whether there is a stream to read, which a first bake that was interrupted does not leave: its
        manifest."""
        return (self.stream / "manifest.json").is_file()

    def initialize_group(self, group: int) -> Path:
        """initialize/group_000: mesh.ply, points.ply, report.json."""
        return self.root / "initialize" / group_name(group)

    def train_group(self, group: int) -> Path:
        """train/group_000: one frame_000000.safetensors per frame, group.json."""
        return self.root / "train" / group_name(group)

    def trained_frame(self, group: int, index: int) -> Path:
        """Gaussians of frame `index`, counted from 0 in the take."""
        return self.train_group(group) / f"frame_{index:06d}.safetensors"

    def finished_frame(self, group: int, index: int) -> Path:
        """The Gaussians of a frame as it is baked, evaluated, edited and exported: of the last stage before `bake`."""
        return self.trained_frame(group, index)

    def trained_files(self) -> tuple[list[Path], tuple[int, ...]]:
        """Files of the finished frames in order, up to the first missing one, and the first index of each group."""
        files: list[Path] = []
        starts: list[int] = []
        while (path := self.finished_frame(len(starts), len(files))).is_file():
            group = len(starts)
            starts.append(len(files))
            while path.is_file():
                files.append(path)
                path = self.finished_frame(group, len(files))
        return files, tuple(starts)

    def separate_frame(self, group: int, index: int) -> Path:
        """The Gaussians of a frame before its group was trained jointly; exists if it was."""
        return self.train_group(group) / f"separate_{index:06d}.safetensors"

    def keyframe_checkpoint(self, group: int) -> Path:
        """Checkpoint of a keyframe in training; deleted when the keyframe is finished."""
        return self.train_group(group) / "keyframe.checkpoint"

    def joint_checkpoint(self, group: int) -> Path:
        """Checkpoint of joint training; deleted when it is finished."""
        return self.train_group(group) / "joint.checkpoint"

    def splat_offsets(self, group: int, rung: str) -> Path:
        """Offsets that fine-tuning added to the splats that a rung keeps; `rung`: "splats50-sh0-1000". Beside it, a
        checkpoint with the suffix ".checkpoint" until that is finished."""
        return self.train_group(group) / f"offsets_{rung}.safetensors"

    def record(self, stage: str) -> Path:
        """Record of a finished stage; absent until it finishes."""
        return self.private / "stages" / f"{stage}.json"

    def failure(self, stage: str) -> Path:
        """Record of a stage's last failure; absent if the last attempt did not fail."""
        return self.private / "stages" / f"{stage}.failed.json"

    def work(self, stage: str) -> Path:
        """A stage's folder for work in progress."""
        return self.private / "work" / stage

    @contextmanager
    def locked(self, command: str, tell: Callable[[Message], None] | None = None) -> Iterator[None]:
        """Lock the take for this process; leftovers of killed runs are deleted first. `command` is recorded for the
        error that a second run gets: StudioError `take.locked` with the fields pid and command. `tell`: see `lock`."""
        self.private.mkdir(parents=True, exist_ok=True)
        with held(self.private / "lock", self.in_use, tell, command=command):
            sweep_partial(self.root)
            yield

    def in_use(self, holder: Mapping[str, Any]) -> StudioError:
        """The error for a take with a run in progress; `holder`: from `running`."""
        pid, command = holder.get("pid"), holder.get("command", "v3studio")
        problem = f"another run is in progress (process {'unknown' if pid is None else pid}, {command})"
        fix = "Wait for it to finish, or stop it; `v3studio status` shows it."
        return StudioError("take.locked", problem, file=self.root, fix=fix, pid=pid, command=command)

    @contextmanager
    def group_locked(self, stage: str, group: int, waiting: Callable[[], None]) -> Iterator[None]:
        """Lock one group of a stage, so that two workers never make the same files; the second waits, and calls
        `waiting`, which may raise, every 0.2 s. On a file system without locks, nothing is locked: files are still
        written atomically, and both workers write the same bytes."""
        folder = self.private / "groups"
        folder.mkdir(parents=True, exist_ok=True)
        with (folder / f"{stage}_{group:03d}.lock").open("a") as file:
            while True:
                with suppress(BlockingIOError):
                    lock(file, wait=False)
                    break
                waiting()
                time.sleep(0.2)
            yield

    def running(self) -> JsonObject | None:
        """`pid`, `command` and `host` of the run in progress; {} if it has just begun; None if there is none."""
        return holder_of(self.private / "lock")

    def keep_groups(self, stage: str, groups: int) -> None:
        """Delete the results of a stage's groups after the first ones."""
        wanted = {group_name(group) for group in range(groups)}
        for folder in (self.root / stage).glob("group_*"):
            if folder.name not in wanted:
                remove(folder)

    def forget(self, stage: str) -> None:
        """Delete a stage's records, before any of its results is replaced, or so that it runs again."""
        remove(self.record(stage))
        remove(self.failure(stage))


def group_name(group: int) -> str:
    """group_000."""
    return f"group_{group:03d}"


def _checked(root: Path | str) -> Path:
    """The folder, absolute. Raises StudioError if it is an address, or its name is not UTF-8."""
    root = root if isinstance(root, Path) else Path(root)
    if is_address(root):
        problem = "a take must be in a folder, not in object storage"
        fix = "Choose a folder; several machines can share one (docs/guides/cluster.md)."
        raise StudioError("take.needs_folder", problem, file=StoreAddress(root), fix=fix)
    need_utf8(root)
    return root.absolute()


def _looks_like(root: Path) -> bool:
    """A take that lost its take.json: settings and the results of some stage are there."""
    return (root / "config.yaml").is_file() and any((root / name).is_dir() for name in ("calibrate", "train", "stream"))
