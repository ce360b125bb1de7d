"""Bakes that are kept: `bakes/NAME/` in a take is itself a take, with one bake and without the training.

It has the stream, the settings, edits and cameras that it was made with, and its evaluation, in the places where a take
has them. So everything that plays, compares, exports, shares or publishes a take does so with a kept bake, and deleting
the folder removes it. Files are hard links to those of the take where the file system has them: keeping a bake costs no
space until the take is baked again. Nothing in a take is changed in place, so links stay as they were.
"""

import functools
import re
import unicodedata
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import JsonValue, ValidationError

from v3studio.pipelines.config.config import Config, values_of
from v3studio.pipelines.config.loading import load_config
from v3studio.pipelines.takes.authored.edits import EDITS_FORMAT, PREFIX, edit_params, read_edits
from v3studio.pipelines.takes.files.settings_file import changed_text
from v3studio.pipelines.takes.results.evaluation import read_evaluation
from v3studio.pipelines.takes.results.integrity import kept_folders, refuse_damage
from v3studio.pipelines.takes.results.records import StageRecord, read_record, result_of
from v3studio.pipelines.takes.results.summaries import BakeSummary
from v3studio.pipelines.takes.take import Take
from v3studio.studio.atomic_files import PARTIAL, atomic_path, link_or_copy, remove, write_json, write_text
from v3studio.studio.counts import span
from v3studio.studio.errors import StudioError
from v3studio.studio.json_types import JsonData, JsonObject
from v3studio.studio.settings import affected, field_named

_NAME = re.compile(r"[^\W_][\w .-]{0,59}")
_DEVICE = re.compile(r"(con|prn|aux|nul|(com|lpt)[0-9¹²³]) *(\..*)?", re.IGNORECASE)
"""Names that Windows keeps for devices, with any ending."""


@dataclass(frozen=True)
class KeptBake:
    """A kept bake: the settings that it was made and measured with, by dotted name, without those that training depends
    on; whether it is the take's stream now, was baked from the present training, and with the present edits (False also
    if those cannot be read); and which of its settings, besides `bake.quality`, differ from the take's."""

    name: str
    take: Take
    record: StageRecord
    summary: BakeSummary
    settings: dict[str, JsonValue]
    bytes: int
    is_stream: bool
    current: bool
    same_edits: bool
    other_settings: tuple[str, ...]

    @property
    def baked(self) -> str:
        """The time of the bake: UTC, ISO 8601."""
        return self.record.finished

    @property
    def psnr(self) -> float | None:
        """Mean PSNR of its decoded frames, dB, from its evaluation; None if it was not measured."""
        try:
            return read_evaluation(self.take.evaluation).summary.psnr_decoded
        except StudioError:  # there is none, or it is damaged, which `v3studio check` reports
            return None

    @property
    def quality(self) -> str:
        """`bake.quality` that it was made with, with the QPs and the PSNR that a level or a size led to."""
        asked, psnr = self.settings.get("bake.quality", ""), self.summary.psnr_to_trained
        if not isinstance(asked, str):
            return str(asked)
        return f"{asked} (QP {span(self.summary.qps)}{'' if psnr is None else f', {psnr:.1f} dB'})"

    def to_json(self) -> JsonObject:
        """A row of `v3studio bake list --json`."""
        return {
            "name": self.name,
            "folder": str(self.take.root),
            "is_stream": self.is_stream,
            "current": self.current,
            "same_edits": self.same_edits,
            "other_settings": list(self.other_settings),
            "baked": self.baked,
            "bytes": self.bytes,
            "bytes_per_frame": self.summary.bytes_per_frame,
            "psnr_decoded": self.psnr,
            "psnr_to_trained": self.summary.psnr_to_trained,
            "qps": list(self.summary.qps),
            "settings": self.settings,
        }


def kept_bakes(take: Take) -> list[KeptBake]:
    """The kept bakes of a take, oldest first; damaged ones and other folders are left out."""
    edits, settings = _present_edits(take), _present_settings(take)
    bakes = [_kept(take, folder, edits, settings) for folder in kept_folders(take) if _NAME.fullmatch(folder.root.name)]
    return sorted((kept for kept in bakes if kept is not None), key=lambda kept: (kept.baked, kept.name))


def _params(records: list[StageRecord]) -> dict[str, JsonValue]:
    return {name: value for record in records for name, value in record.params.items()}


def _settings_of(params: dict[str, JsonValue]) -> dict[str, JsonValue]:
    """The settings among parameters of stages, by dotted name, also those that this version does not have."""
    results = affected(Config)
    settings = {name: value for name, value in params.items() if name.partition(".")[0] in Config.model_fields}
    known = [set(results[name]) for name in settings if results.get(name)]
    for name, default in values_of(Config()).items():
        # a setting was recorded for one of its results, and with it the items, if any, of those that affect all of them
        if isinstance(default, dict) and any(set(results[name]).issuperset(other) for other in known):
            items = [key for key in settings if key.startswith(f"{name}.")]
            settings[name] = {key[len(name) + 1 :]: settings.pop(key) for key in items}
    return settings


@functools.cache
def _of_training() -> frozenset[str]:
    """The settings that training depends on."""
    later = {"videos", "manifest", "sound", "evaluation"}
    return frozenset(name for name, made in affected(Config).items() if not later.issuperset(made))


def _kept(take: Take, kept: Take, edits: dict[str, JsonData] | None, settings: dict[str, JsonValue]) -> KeptBake | None:
    record = read_record(kept, "bake")
    if record is None:
        return None
    try:
        summary = BakeSummary.model_validate(record.summary)
    except ValidationError:  # damaged
        return None
    params = _params([record, *_evaluation_of(kept, record)])
    own = {name: value for name, value in _settings_of(params).items() if name not in _of_training()}
    return KeptBake(
        name=kept.root.name,
        take=kept,
        record=record,
        summary=summary,
        settings=own,
        bytes=sum(path.stat().st_size for path in kept.stream.rglob("*") if path.is_file()),
        is_stream=result_of(take, "bake") == record.result,
        current=all(result_of(take, stage) == result for stage, result in _sources(record).items()),
        same_edits=_edits_of(record.params) == edits,
        other_settings=tuple(
            name for name, value in own.items() if name != "bake.quality" and settings.get(name, value) != value
        ),
    )


def _edits_of(params: dict[str, JsonValue]) -> dict[str, JsonValue]:
    return {name: value for name, value in params.items() if name.startswith(PREFIX)}


def _present_edits(take: Take) -> dict[str, JsonData] | None:
    """The take's edits as parameters of a bake; None if they cannot be read."""
    try:
        return edit_params(read_edits(take.edits))
    except StudioError:
        return None


def _present_settings(take: Take) -> dict[str, JsonValue]:
    """The take's settings by dotted name; none if they cannot be read."""
    try:
        return values_of(load_config(take.config))
    except StudioError:
        return {}


def free_name(take: Take, name: str) -> str:
    """Check that a bake can be kept under a name, as before a long run; returns it in composed form (NFC)."""
    name = unicodedata.normalize("NFC", name)
    fits = _NAME.fullmatch(name) and name[-1] not in " ." and len(name.encode()) <= 120
    if not fits or PARTIAL in name or _DEVICE.fullmatch(name):
        fix = (
            "Use up to 60 letters, digits, spaces and . - _, beginning with a letter or a digit; no "
            f"'{PARTIAL}' and no name that Windows keeps for a device."
        )
        raise StudioError("bakes.invalid_name", f"'{name}' cannot be the name of a bake", value=name, fix=fix)
    if (take.bakes / name).exists():
        problem = f"a bake is already kept as '{name}'"
        fix = "Choose another name, or remove that one: `v3studio bake remove`."
        raise StudioError("bakes.name_taken", problem, file=take.bakes / name, value=name, fix=fix)
    return name


def keep_bake(take: Take, name: str) -> KeptBake:
    """Keep the take's stream under a name. The caller holds the take's lock. StudioError: `bakes.invalid_name`,
    `bakes.name_taken`, there is no finished stream (`bakes.not_baked`), or files are not what the last finished bake or
    evaluation wrote (`take.damaged`). OSError: the disk is full, for example; nothing is left behind."""
    name = free_name(take, name)
    record = read_record(take, "bake")
    if record is None or not take.has_stream:
        fix = "Run `v3studio bake` first."
        raise StudioError("bakes.not_baked", "there is no finished bake to keep", file=take.root, fix=fix, stage="bake")
    records = [record, *_evaluation_of(take, record)]
    made_from = _made_from(take, record)
    params = _params([*made_from, *records[1:]])
    settings = {name: value for name, value in _settings_of(params).items() if field_named(Config, name)}
    # in the file, it may be relative to the take
    settings |= {name: value for name, value in _present_settings(take).items() if name == "capture.root"}
    for source in records:
        refuse_damage(
            take, source.stage, f"Run `v3studio {source.stage}` again, with --force if it finds nothing to do."
        )
    with atomic_path(take.bakes / name, durable=True) as folder:
        for path in _files_of(take, records):
            _link(path, folder / path.relative_to(take.root))
        text = changed_text(take.config, settings) or take.config.read_text(encoding="utf-8")
        write_text(folder / "config.yaml", text, durable=True)
        if _present_edits(take) != _edits_of(record.params):  # it was edited since
            edits: dict[str, Any] = {name.removeprefix(PREFIX): value for name, value in _edits_of(params).items()}
            if any(f"{PREFIX}crop" in source.params for source in made_from if source.stage == "train"):
                edits["crop"] = {**edits["crop"], "training": True}
            write_json(folder / "edits.json", {"format": EDITS_FORMAT, "edits": edits}, durable=True)
    return next(kept for kept in kept_bakes(take) if kept.name == name)


def _files_of(take: Take, records: list[StageRecord]) -> list[Path]:
    """Files of a take that make up a kept bake, apart from its settings."""
    files = [take.root / "take.json", take.edits, take.garbage, take.rig, take.refined_rig, take.calibration_report]
    files += [take.record(record.stage) for record in records]
    files += [take.root / name for record in records for name in record.files]
    return [path for path in files if path.is_file()]


def _sources(record: StageRecord) -> dict[str, JsonValue]:
    """The results that a stage was made from, by the stage that made each."""
    named = [(re.fullmatch("result of ([a-z]+)", name), value) for name, value in record.params.items()]
    return {name[1]: value for name, value in named if name}


def _made_from(take: Take, record: StageRecord) -> list[StageRecord]:
    """The record after those of all that the stage was made from, as far as the take still has these results."""
    chain = [record]
    for later in chain:
        for stage, result in _sources(later).items():
            source = read_record(take, stage)
            if source is not None and source.result == result and source not in chain:
                chain.append(source)
    return chain[::-1]


def _evaluation_of(take: Take, bake: StageRecord) -> list[StageRecord]:
    """The record of the take's evaluation, if it measured this stream."""
    record = read_record(take, "evaluate")
    return [record] if record is not None and record.params.get("result of bake") == bake.result else []


def kept_bake(take: Take, name: str) -> KeptBake:
    by_name = {kept.name: kept for kept in kept_bakes(take)}
    name = unicodedata.normalize("NFC", name)
    if name not in by_name:
        fix = f"Kept are: {', '.join(by_name)}." if by_name else "`v3studio bake keep TAKE NAME` keeps the stream."
        raise StudioError("bakes.not_found", f"no bake is kept as '{name}'", file=take.root, value=name, fix=fix)
    return by_name[name]


def remove_bake(take: Take, name: str) -> None:
    """Delete a kept bake; the take's stream stays. The caller holds the lock. Raises StudioError."""
    remove(kept_bake(take, name).take.root)


def note_evaluation(take: Take) -> None:
    """Give kept bakes that are the take's stream its new evaluation. The caller holds the lock. StudioError if the
    evaluation is not what was recorded (`take.damaged`); OSError if a file cannot be written."""
    for kept in kept_bakes(take):
        before = result_of(kept.take, "evaluate")
        for record in _evaluation_of(take, kept.record):
            if record.result != before:
                refuse_damage(take, "evaluate")
                for path in (*(take.root / name for name in record.files), take.record("evaluate")):
                    _link(path, kept.take.root / path.relative_to(take.root))


def _link(source: Path, target: Path) -> None:
    """Hard-link or copy a file. Raises OSError."""
    with atomic_path(target, durable=True) as temporary:
        link_or_copy(str(source), str(temporary))
