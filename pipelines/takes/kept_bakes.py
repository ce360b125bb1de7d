"""Bakes that are kept: `bakes/NAME/` in a take is itself a take, with one bake and without the training.

It has the stream, the settings, edits and cameras that it was made with, and its evaluation, in the places where a take
has them. So everything that plays, compares, exports, shares or publishes a take does so with a kept bake. Files are
hard links to those of the take where the file system has them: keeping a bake costs no space until the take is baked
again. Nothing in a take is changed in place, so links stay as they were.
"""

from __future__ import annotations

import os
import re
import shutil
import unicodedata
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from pydantic import JsonValue

from pipelines.config.loading import load_config
from pipelines.takes.atomic_files import digest_of_file, link_or_copy, remove, write_text
from pipelines.takes.edits import PREFIX, edit_params, read_edits
from pipelines.takes.evaluation import read_evaluation
from pipelines.takes.integrity import changed_files
from pipelines.takes.records import StageRecord, read_record, result_of
from pipelines.takes.settings_file import changed_text, set_settings
from pipelines.takes.take import Take
from studio.atomic_files import PARTIAL, atomic_path, exchange, temporary_path
from studio.errors import StudioError
from studio.json_types import JsonData, JsonObject

_NAME = re.compile(r"[^\W_][\w .-]{0,59}")
_DEVICE = re.compile(r"(con|prn|aux|nul|(com|lpt)[0-9¹²³]) *(\..*)?", re.IGNORECASE)
"""Names that Windows keeps for devices, with any ending."""


@dataclass(frozen=True)
class KeptBake:
    """A kept bake.

    Attributes:
        name: as the user named it.
        take: the folder, as a take.
        record: of the stage `bake`.
        bytes: size of the stream.
        frees: bytes that are free again after it is removed: of files that nothing else in the take shares.
        chosen: whether it is the take's stream now.
        current: whether it was baked from the take's present training.
        same_edits: whether it was baked with the take's present edits; False also if those cannot be read.
    """

    name: str
    take: Take
    record: StageRecord
    bytes: int
    frees: int
    chosen: bool
    current: bool
    same_edits: bool

    @property
    def baked(self) -> str:
        """When, UTC, ISO 8601."""
        return self.record.finished

    @property
    def bytes_per_frame(self) -> float:
        """Of the stream's best rendition; 0 if its record lacks it."""
        value = self.record.summary.get("bytes_per_frame")
        return float(value) if isinstance(value, int | float) else 0.0

    @property
    def psnr(self) -> float | None:
        """Mean PSNR of its decoded frames, dB, from its evaluation; None if it was not measured."""
        try:
            return read_evaluation(self.take.evaluation).summary.psnr_decoded
        except StudioError:  # there is none, or it is damaged, which `v3studio check` reports
            return None

    @property
    def settings(self) -> dict[str, JsonValue]:
        """Settings of `bake` that it was made with, by dotted name."""
        return {name: value for name, value in self.record.params.items() if name.startswith("bake.")}

    @property
    def quality(self) -> str:
        """`bake.quality` that it was made with."""
        return str(self.settings.get("bake.quality", ""))

    @property
    def remarks(self) -> list[str]:
        """Sentences on what the next run would change if it was chosen."""
        found = []
        if not self.current:
            found.append("The take was trained again after it was baked; `v3studio run` would bake the new training.")
        if not self.same_edits:
            found.append("It was baked with other edits than the take has now; `v3studio run` would bake with those.")
        return found

    def to_json(self) -> JsonObject:
        """A row of `v3studio bakes list --json`."""
        return {
            "name": self.name,
            "folder": str(self.take.root),
            "chosen": self.chosen,
            "current": self.current,
            "same_edits": self.same_edits,
            "baked": self.baked,
            "bytes": self.bytes,
            "frees": self.frees,
            "bytes_per_frame": self.bytes_per_frame,
            "psnr_decoded": self.psnr,
            "settings": self.settings,
        }


def kept_bakes(take: Take) -> list[KeptBake]:
    """The kept bakes of a take, oldest first; damaged ones and other folders are left out."""
    folders = sorted(take.bakes.iterdir()) if take.bakes.is_dir() else []
    edits = _present_edits(take)
    found = [_kept(take, folder, edits) for folder in folders if _NAME.fullmatch(folder.name)]
    return sorted((kept for kept in found if kept is not None), key=lambda kept: (kept.baked, kept.name))


def kept_bake(take: Take, name: str) -> KeptBake:
    """The kept bake of a name.

    Raises:
        StudioError: there is none (`bakes.not_found`), or no bake can have the name (`bakes.invalid_name`).
    """
    folder = take.bakes / check_name(name)
    found = _kept(take, folder, _present_edits(take))
    if found is None:
        known = ", ".join(kept.name for kept in kept_bakes(take))
        raise StudioError(
            "bakes.not_found",
            f"no bake is kept as '{folder.name}'",
            file=take.root,
            value=name,
            fix=f"There are: {known}." if known else "Keep the present one with `v3studio bakes keep`.",
        )
    return found


def _kept(take: Take, folder: Path, edits: dict[str, JsonData] | None) -> KeptBake | None:
    kept = Take(folder)
    record = read_record(kept, "bake")
    if record is None or not (folder / "take.json").is_file():
        return None
    return KeptBake(
        name=folder.name,
        take=kept,
        record=record,
        bytes=sum(state.st_size for state in _states(kept.stream)),
        frees=sum(state.st_size for state in _states(folder) if state.st_nlink == 1),
        chosen=result_of(take, "bake") == record.result,
        current=record.params.get("result of train") == result_of(take, "train"),
        same_edits={name: value for name, value in record.params.items() if name.startswith(PREFIX)} == edits,
    )


def _present_edits(take: Take) -> dict[str, JsonData] | None:
    """The take's edits as parameters of a bake; None if they cannot be read."""
    try:
        return edit_params(read_edits(take.edits))
    except StudioError:
        return None


def _states(folder: Path) -> Iterator[os.stat_result]:
    return (path.stat() for path in folder.rglob("*") if path.is_file())


def check_name(name: str) -> str:
    """Check a name of a kept bake; returns it as the folder is named: accented letters in composed form (NFC).

    Raises:
        StudioError: it cannot be the name of a folder on every system, or is one of temporary files
            (`bakes.invalid_name`).
    """
    name = unicodedata.normalize("NFC", name)
    fits = _NAME.fullmatch(name) and name[-1] not in " ." and len(name.encode()) <= 120
    if not fits or PARTIAL in name or _DEVICE.fullmatch(name):
        raise StudioError(
            "bakes.invalid_name",
            f"'{name}' cannot be the name of a bake",
            value=name,
            fix="Use up to 60 letters, digits, spaces and . - _, beginning with a letter or a digit; no "
            f"'{PARTIAL}' and no name that Windows keeps for a device.",
        )
    return name


def refuse_taken(take: Take, name: str) -> str:
    """Check, before a long run, that a bake can be kept under a name; returns it as `check_name`.

    Raises:
        StudioError: no bake can have it (`bakes.invalid_name`), or another one has it (`bakes.name_taken`).
    """
    name = check_name(name)
    if (take.bakes / name).exists():
        raise StudioError(
            "bakes.name_taken",
            f"a bake is already kept as '{name}'",
            file=take.bakes / name,
            value=name,
            fix=f"Choose another name, or remove it with `v3studio bakes remove TAKE {name}`.",
        )
    return name


def keep_bake(take: Take, name: str) -> KeptBake:
    """Keep the take's stream under a name. The caller holds the take's lock.

    Raises:
        StudioError: `bakes.invalid_name`, `bakes.name_taken`, there is no finished stream (`bakes.not_baked`), or files
            are not what the last finished bake or evaluation wrote (`take.damaged`).
        OSError: the disk is full, for example; nothing is left behind.
    """
    name = refuse_taken(take, name)
    record = read_record(take, "bake")
    if record is None or not (take.stream / "manifest.json").is_file():
        raise StudioError(
            "bakes.not_baked",
            "there is no finished bake to keep",
            file=take.root,
            fix="Run `v3studio bake` first.",
            stage="bake",
        )
    records = [record, *_evaluation_of(take, record)]
    for one in records:
        _refuse_changed(take, one, f"Run `v3studio {one.stage}` again, with --force if it finds nothing to do.")
    settings = {name: value for name, value in record.params.items() if name.startswith("bake.")}
    with atomic_path(take.bakes / name, durable=True) as folder:
        for path in _files_of(take, records):
            _link(path, folder / path.relative_to(take.root))
        text = changed_text(take.config, settings) or take.config.read_text(encoding="utf-8")
        write_text(folder / "config.yaml", text, durable=True)
    return kept_bake(take, name)


def _files_of(take: Take, records: list[StageRecord]) -> list[Path]:
    """Files of a take that make up a kept bake, apart from its settings."""
    files = [take.root / "take.json", take.edits, take.garbage, take.rig, take.calibration_report]
    files += [take.record(record.stage) for record in records]
    files += [take.root / name for record in records for name in record.files]
    files += sorted(take.work("bake").glob("group_*.json"))
    return [path for path in files if path.is_file()]


def _evaluation_of(take: Take, bake: StageRecord) -> list[StageRecord]:
    """The record of the take's evaluation, if it measured this stream."""
    record = read_record(take, "evaluate")
    return [record] if record is not None and record.params.get("result of bake") == bake.result else []


def note_evaluation(take: Take) -> None:
    """Give kept bakes that are the take's stream its new evaluation. The caller holds the lock.

    Raises:
        StudioError: the evaluation is not what was recorded (`take.damaged`).
        OSError: a file cannot be written.
    """
    for kept in kept_bakes(take):
        before = result_of(kept.take, "evaluate")
        for record in _evaluation_of(take, kept.record):
            if record.result != before:
                _refuse_changed(take, record, "Run `v3studio evaluate --force`.")
                for path in (*(take.root / name for name in record.files), take.record("evaluate")):
                    _link(path, kept.take.root / path.relative_to(take.root))


def folder_of_bake(take: Take, name: str) -> Path:
    """The folder of a kept bake, also of a damaged one. Raises StudioError as `kept_bake`."""
    folder = take.bakes / check_name(name)
    return folder if folder.is_dir() else kept_bake(take, name).take.root


def remove_bake(take: Take, name: str) -> int:
    """Delete a kept bake; returns the bytes that are free again. The take's stream stays, also if it is the same.

    Raises:
        StudioError: `bakes.not_found` or `bakes.invalid_name`.
        OSError: it cannot be deleted.
    """
    folder = folder_of_bake(take, name)
    frees = sum(state.st_size for state in _states(folder) if state.st_nlink == 1)
    gone = temporary_path(folder)
    os.rename(folder, gone)  # in one step: a killed removal leaves no half of it
    remove(gone)
    if not any(take.bakes.iterdir()):
        take.bakes.rmdir()
    return frees


def choose_bake(take: Take, name: str, *, discard: bool = False) -> KeptBake:
    """Make a kept bake the take's stream, with its settings and its evaluation. The caller holds the take's lock.

    Everything is checked and prepared before the records of the present stream are deleted. If this is interrupted
    after that, the take has no finished bake until it is repeated; the kept bakes are whole at every moment.

    Args:
        take: the take.
        name: of the kept bake.
        discard: the present stream may be lost although it is not kept under any name.

    Raises:
        StudioError: `bakes.not_found`, `bakes.invalid_name`, files of the kept bake are damaged (`take.damaged`), the
            present stream is not kept (`bakes.would_be_lost`), or config.yaml cannot be read or is not valid with the
            settings of the kept bake (`settings.*`).
        OSError: a file cannot be written.
    """
    kept = kept_bake(take, name)
    records = [kept.record, *_evaluation_of(kept.take, kept.record)]
    for record in records:
        _refuse_changed(kept.take, record, f"Remove it with `v3studio bakes remove {take.root} '{kept.name}'`.")
    if not discard:
        _refuse_loss(take)
    load_config(take.config, kept.settings.items())
    new = temporary_path(take.stream)
    try:
        shutil.copytree(kept.take.stream, new, copy_function=link_or_copy)
        set_settings(take.config, kept.settings)
        for stage in ("evaluate", "bake"):
            take.forget(stage)
        _put_stream(take, new)
    finally:
        remove(new)
    for path in (take.work("bake"), take.evaluation, take.report):
        remove(path)
    for path in sorted(kept.take.work("bake").glob("group_*.json")):
        _link(path, take.work("bake") / path.name)
    for record in records:
        for file in (kept.take.root / name for name in record.files if not name.startswith("stream/")):
            _link(file, take.root / file.name)
        _link(kept.take.record(record.stage), take.record(record.stage))
    return kept_bake(take, kept.name)


def _refuse_changed(take: Take, record: StageRecord, fix: str) -> None:
    """Raises StudioError if a file is not as it was recorded (`take.damaged`)."""
    for found in filter(None, changed_files(take, record)):
        raise StudioError(
            "take.damaged",
            f"the file is {found.problem}: it is not what the stage {record.stage} wrote when it last finished",
            file=take.root / found.file,
            fix=fix,
            stage=record.stage,
        )


def _refuse_loss(take: Take) -> None:
    """Raises StudioError if the present stream is not kept, or only with damage (`bakes.would_be_lost`). Its record is
    missing after an interrupted `choose_bake`."""
    manifest = take.stream / "manifest.json"
    if not manifest.is_file():
        return
    digest = digest_of_file(manifest)
    same = [kept for kept in kept_bakes(take) if kept.record.digests.get("stream/manifest.json") == digest]
    if any(not any(changed_files(kept.take, kept.record)) for kept in same):
        return
    damaged = f", except as '{same[0].name}', whose files are damaged," if same else ""
    raise StudioError(
        "bakes.would_be_lost",
        f"the present stream is not kept under a name{damaged} and would be lost",
        file=take.stream,
        fix="Keep it with `v3studio bakes keep TAKE NAME`, or add --discard.",
    )


def _put_stream(take: Take, new: Path) -> None:
    """Replace the take's stream, in one step where the system can."""
    if not take.stream.exists():
        os.rename(new, take.stream)
    elif not exchange(new, take.stream):
        old = temporary_path(take.stream)
        os.rename(take.stream, old)
        os.rename(new, take.stream)
        remove(old)


def _link(source: Path, target: Path) -> None:
    """Hard-link or copy a file. Raises OSError."""
    with atomic_path(target, durable=True) as temporary:
        link_or_copy(str(source), str(temporary))
