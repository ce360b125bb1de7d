"""Migrates a take of format 1 to the names of format 2, when a run first locks it.

Every step can be repeated, and take.json gets its new format number last, so a killed migration resumes. Until then
the take is read as is (`Take.file`, `pipelines.takes.records`).
"""

from __future__ import annotations

import contextlib
import os
from pathlib import Path
from typing import Any

from pipelines.config.loading import dump_tree, read_yaml
from pipelines.config.renamed import REPORT_KEYS, STAGES, renamed
from pipelines.takes.atomic_files import read_json, write_json, write_text
from pipelines.takes.records import current_record
from pipelines.takes.take import TAKE_FORMAT, Take
from studio.errors import StudioError


def migrate(take: Take) -> bool:
    """Migrate the take to `TAKE_FORMAT`. The caller holds the lock.

    Results, their digests and the keys of frames do not change, so nothing becomes stale.

    Returns:
        False if the take already has the current format.

    Raises:
        StudioError: take.json cannot be read (`take.damaged`).
        OSError: the folder cannot be written.
    """
    about = read_json(take.root / "take.json")
    if about.get("format") == TAKE_FORMAT:
        return False
    for before, now in STAGES.items():
        for folder, endings in (
            (take.root, ("",)),
            (take.private / "stages", (".json", ".failed.json")),
            (take.private / "work", ("",)),
        ):
            for ending in endings:
                old, new = folder / f"{before}{ending}", folder / f"{now}{ending}"
                if old.exists() and not new.exists():
                    os.rename(old, new)
    for path in sorted((take.private / "stages").glob("*.json")):
        _rewrite_record(path)
    with contextlib.suppress(StudioError):  # unreadable settings are reported when they are used
        values, changes = renamed(read_yaml(take.config), str(take.config))
        if changes:
            write_text(take.config, dump_tree(values))
    with contextlib.suppress(StudioError):
        report = read_json(take.calibration_report)
        if current_report(report) != report:
            write_json(take.calibration_report, current_report(report))
    write_json(take.root / "take.json", {**about, "format": TAKE_FORMAT})
    return True


def _rewrite_record(path: Path) -> None:
    with contextlib.suppress(StudioError):  # a damaged record counts as none and is left as is
        record = read_json(path)
        if not isinstance(record, dict):
            return
        if path.name.endswith(".failed.json"):
            found: dict[str, Any] | None = {**record, "stage": path.name.removesuffix(".failed.json")}
        else:
            found = current_record(record)
        if found is not None and found != record:
            write_json(path, found)


def current_report(value: Any) -> Any:
    """A calibration report with current keys."""
    if isinstance(value, dict):
        return {REPORT_KEYS.get(key, key): current_report(item) for key, item in value.items()}
    return [current_report(item) for item in value] if isinstance(value, list) else value
