"""A kept bake becomes the take's stream again, with its settings and its evaluation."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path

from pydantic import JsonValue

from pipelines.config.loading import all_names, load_config
from pipelines.takes.atomic_files import digest_of_file, link_or_copy, remove, write_model
from pipelines.takes.kept_bakes import (
    NOTE,
    KeptBake,
    changed_files,
    kept_bake,
    kept_bakes,
    link,
    recorded_files,
    refuse_damaged,
    refuse_missing,
)
from pipelines.takes.settings_file import changed_text
from pipelines.takes.take import Take
from studio.atomic_files import atomic_path, exchange, temporary_path
from studio.errors import StudioError


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
            present stream is not kept (`bakes.would_be_lost`), config.yaml cannot be read or updated (`settings.*`),
            or would not be valid with the kept bake's settings (`bakes.settings_refused`).
        OSError: a file cannot be written.
    """
    kept = kept_bake(take, name)
    refuse_damaged(take, kept)
    links = {kept.folder / "notes" / file: take.work("bake") / file for file in kept.note.notes}
    if kept.note.evaluate is not None:
        links |= {kept.folder / path.name: path for path in (take.evaluation, take.report)}
    refuse_missing(take, kept, links)
    if not discard:
        _refuse_loss(take, kept)
    settings = _settings_for(take, kept)
    text = changed_text(take.config, settings)
    with _linked(kept.stream, take.stream) as stream:
        with nullcontext() if text is None else atomic_path(take.config) as config:
            if config is not None and text is not None:
                config.write_text(text, encoding="utf-8")
            for stage in ("evaluate", "bake"):
                take.forget(stage)
        _put_stream(take, stream)
    for path in (take.work("bake"), take.evaluation, take.report):
        remove(path)
    for source, target in links.items():
        link(source, target)
    write_model(take.record("bake"), kept.note.bake)
    if kept.note.evaluate is not None:
        write_model(take.record("evaluate"), kept.note.evaluate)
    return kept_bake(take, kept.name)


def remarks(kept: KeptBake) -> list[str]:
    """Sentences on what a chosen bake does not bring back, and what the next run would change."""
    found = []
    unknown = sorted(kept.settings.keys() - set(all_names()))
    if unknown:
        found.append(f"This version has no setting {', '.join(unknown)}; config.yaml does not get it.")
    if not kept.current:
        found.append("The take has been trained anew since it was baked; `v3studio run` would bake the new training.")
    if not kept.same_edits:
        found.append("It was baked with other edits than the take has now; `v3studio run` would bake with those.")
    return found


def _settings_for(take: Take, kept: KeptBake) -> dict[str, JsonValue]:
    """Settings of a kept bake that this version has, checked together with the others in config.yaml."""
    path = take.config if take.config.is_file() else None
    load_config(path)  # what is wrong without them is the file's own mistake
    known = set(all_names())
    settings = {name: value for name, value in kept.settings.items() if name in known}
    try:
        load_config(path, settings.items())
    except StudioError as error:
        raise StudioError(
            "bakes.settings_refused",
            f"config.yaml would not be valid with the settings of '{kept.name}': {error.problem}",
            file=kept.folder / NOTE,
            fix="Correct the setting in config.yaml that it does not go with, or remove this bake.",
        ) from None
    return settings


def _refuse_loss(take: Take, intact: KeptBake) -> None:
    """Check that nothing is lost with the present stream. Its record does not tell after an interrupted `choose_bake`.

    Args:
        take: the take.
        intact: the kept bake whose files were compared already.

    Raises:
        StudioError: it is not kept, or only with damaged files (`bakes.would_be_lost`).
    """
    manifest = take.stream / "manifest.json"
    if not manifest.is_file():
        return
    digest = digest_of_file(manifest)
    same = [kept for kept in kept_bakes(take) if dict(recorded_files(kept)).get("stream/manifest.json") == digest]
    if any(kept.name == intact.name or not any(problem for _, problem in changed_files(kept)) for kept in same):
        return
    damaged = f", except as '{same[0].name}', whose files are damaged," if same else ""
    raise StudioError(
        "bakes.would_be_lost",
        f"the present stream is not kept under a name{damaged} and would be lost",
        file=take.stream,
        fix="Keep it with `v3studio bakes keep TAKE NAME`, or add --discard.",
    )


@contextmanager
def _linked(source: Path, target: Path) -> Iterator[Path]:
    """A folder beside `target` with the files of `source`; what is in its place at the end is deleted."""
    new = temporary_path(target)
    try:
        shutil.copytree(source, new, copy_function=link_or_copy)
        yield new
    finally:
        remove(new)


def _put_stream(take: Take, new: Path) -> None:
    """Replace the take's stream, in one step where the system can."""
    if not take.stream.exists():
        os.rename(new, take.stream)
    elif not exchange(new, take.stream):
        old = temporary_path(take.stream)
        os.rename(take.stream, old)
        os.rename(new, take.stream)
        remove(old)
