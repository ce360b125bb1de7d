"""Finds damage on disk: compares the files of a take with the digests that were recorded when they were written."""

import itertools
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict

from v3studio.pipelines.takes.authored.edits import read_edits
from v3studio.pipelines.takes.authored.marks import read_marks
from v3studio.pipelines.takes.files.digests import digest_of_file
from v3studio.pipelines.takes.files.json_files import read_model
from v3studio.pipelines.takes.frames.frame_files import intact
from v3studio.pipelines.takes.results.records import StageRecord, read_record
from v3studio.pipelines.takes.take import Take
from v3studio.studio.errors import StudioError
from v3studio.studio.progress import ProgressFn, no_progress


class Damage(BaseModel):
    """A file that is not what the program wrote."""

    model_config = ConfigDict(frozen=True)

    file: str  # relative to the take

    stage: str
    """The stage that wrote it, and that has to run again; "" for what no run makes again: files of kept bakes, and
    edits.json, garbage.yaml, marks.json and camera_path.json."""

    problem: Literal["changed", "missing", "damaged"]
    """changed: another content than recorded; missing; damaged: its own checksum is wrong, or it cannot be read."""

    detail: str = ""  # what cannot be read in it; "" if only its checksum tells


class Integrity(BaseModel):
    """The result of `check_take`."""

    model_config = ConfigDict(frozen=True)

    files: int  # checked
    bytes: int
    damage: tuple[Damage, ...]

    unchecked: tuple[str, ...]
    """Stages that have not finished: nothing is recorded of their files. Trained frames hold their own checksums."""


def check_take(take: Take, stages: Iterable[str], progress: ProgressFn = no_progress) -> Integrity:
    """Read all results of the finished stages, all trained frames and all kept bakes, and compare them with what was
    recorded; read what people made: edits, marks, camera path. `progress` gets the files checked and those known of."""
    damage: list[Damage] = []
    unchecked: list[str] = []
    files: list[Path] = []
    work: list[Iterator[Damage | None]] = []
    for stage in stages:
        record = read_record(take, stage)
        if record is not None:
            files += [take.root / name for name in record.files]
            work.append(changed_files(take, record))
            continue
        unchecked.append(stage)
        if stage == "train":
            frames = sorted((take.root / stage).rglob("*.safetensors"))
            files += frames
            work.append(_damaged_tensors(take, path) for path in frames)
    for kept in kept_folders(take):
        for record in filter(None, (read_record(kept, stage) for stage in ("bake", "evaluate"))):
            files += [kept.root / name for name in record.files]
            work.append(_changed_of_kept(take, kept, record))
    made = {path: read for path, read in _made_by_people(take).items() if path.exists()}
    files += made
    work.append(_unreadable(take, path, read) for path, read in made.items())
    for done, problem in enumerate(itertools.chain(*work), 1):
        progress(done, max(done, len(files)))
        damage += [problem] if problem else []
    size = sum(path.stat().st_size for path in files if path.is_file())
    return Integrity(files=len(files), bytes=size, damage=tuple(damage), unchecked=tuple(unchecked))


def refuse_damage(take: Take, stage: str, fix: str = "") -> None:
    """Check the results of a finished stage before they are used."""
    record = read_record(take, stage)
    for damage in filter(None, changed_files(take, record) if record else ()):
        raise StudioError(
            "take.damaged",
            f"the file is {damage.problem}: it is not what the stage {stage} wrote when it last finished",
            file=take.root / damage.file,
            fix=fix or f"Run `v3studio {stage} --force`.",
            stage=stage,
        )


def changed_files(take: Take, record: StageRecord) -> Iterator[Damage | None]:
    """Yield the damage of each file that a stage wrote, or None."""
    for name in record.files:
        path = take.root / name
        if not path.is_file():
            yield Damage(file=name, stage=record.stage, problem="missing")
        elif digest_of_file(path) != record.digests.get(name):
            yield Damage(file=name, stage=record.stage, problem="changed")
        else:
            yield None


def kept_folders(take: Take) -> list[Take]:
    """Kept bakes (`pipelines.takes.results.kept_bakes`), also damaged ones; no folders of others."""
    folders = sorted(take.bakes.iterdir()) if take.bakes.is_dir() else []
    return [Take(folder) for folder in folders if not folder.name.startswith(".") and (folder / "take.json").is_file()]


def _changed_of_kept(take: Take, kept: Take, record: StageRecord) -> Iterator[Damage | None]:
    folder = kept.root.relative_to(take.root).as_posix()
    for damage in changed_files(kept, record):
        yield damage and damage.model_copy(update={"file": f"{folder}/{damage.file}", "stage": ""})


def _made_by_people(take: Take) -> dict[Path, Callable[[Path], object]]:
    """Files that no stage writes, and the records of kept bakes, and what reads each."""
    from v3studio.studio.formats.camera_path import read_path_keys
    from v3studio.studio.masks.garbage_polygons import read_garbage_polygons

    return {
        take.edits: read_edits,
        take.marks: read_marks,
        take.garbage: read_garbage_polygons,
        take.camera_path: lambda path: read_path_keys(path, 1.0),
        **{kept.record("bake"): lambda path: read_model(path, StageRecord) for kept in kept_folders(take)},
    }


def _unreadable(take: Take, path: Path, read: Callable[[Path], object]) -> Damage | None:
    name = path.relative_to(take.root).as_posix()
    if not path.is_file():
        return Damage(file=name, stage="", problem="missing")
    try:
        read(path)
    except StudioError as error:
        return Damage(file=name, stage="", problem="damaged", detail=error.problem)
    return None


def _damaged_tensors(take: Take, path: Path) -> Damage | None:
    if intact(path):
        return None
    return Damage(file=path.relative_to(take.root).as_posix(), stage="train", problem="damaged")
