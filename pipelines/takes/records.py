"""What was noted when a stage finished or failed."""

from __future__ import annotations

from typing import Any

from pipelines.config.renamed import REPORT_KEYS, current_name, current_names, current_path
from pipelines.takes.atomic_files import digest_of_files, read_json, write_json
from pipelines.takes.take import Take
from studio.errors import StudioError


def read_record(take: Take, stage: str) -> dict[str, Any] | None:
    """What the stage's results were made from, their digest, time taken and summary; None if it never finished.

    A damaged record vouches for nothing and counts as none: the stage runs again.
    """
    path = take.record(stage)
    if not path.is_file():
        return None
    try:
        record = read_json(path)
    except StudioError:
        return None
    return current_record(record) if isinstance(record, dict) and "result" in record else None


def current_record(record: dict[str, Any]) -> dict[str, Any] | None:
    """A record of any format with the names of now; None where it is no record."""
    params = record.get("params", record.get("ingredients"))
    if not isinstance(params, dict):
        return None
    found = {name: value for name, value in record.items() if name != "ingredients"}
    found["params"] = current_names(params)
    found["stage"] = current_name(str(record.get("stage", "")))
    for table in ("files", "written"):
        if isinstance(found.get(table), dict):
            found[table] = {current_path(name): value for name, value in found[table].items()}
    if isinstance(found.get("summary"), dict):
        found["summary"] = {REPORT_KEYS.get(name, name): value for name, value in found["summary"].items()}
    return found


def note_rewritten(take: Take, stage: str) -> None:
    """A finished stage's files were written anew by the program, and still say the same."""
    record = read_record(take, stage)
    if record is None:
        return
    files = [take.file(name) for name in record["files"]]
    record["result"] = digest_of_files(take.root, files)
    for what, value in (("files", "st_size"), ("written", "st_mtime_ns")):
        record[what] = {
            current_path(path.relative_to(take.root).as_posix()): getattr(path.stat(), value) for path in files
        }
    write_json(take.record(stage), record)


def result_of(take: Take, stage: str) -> str | None:
    """Digest of what a finished stage left; None if it is not finished."""
    record = read_record(take, stage)
    return str(record["result"]) if record else None


def write_failure(take: Take, stage: str, message: str) -> None:
    """Note why the stage failed."""
    write_json(take.failure(stage), {"stage": stage, "message": message})


def read_failure(take: Take, stage: str) -> str:
    """Why the stage's last attempt failed; "" if it did not."""
    path = take.failure(stage)
    if not path.is_file():
        return ""
    try:
        return str(read_json(path).get("message", ""))
    except (StudioError, AttributeError):
        return ""
