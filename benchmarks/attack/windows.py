"""The real window on a private X server, with mutated streams and takes."""

from __future__ import annotations

import random
import shutil
from pathlib import Path

from hostile_streams import mutate, read_stream
from mutations import changed
from outcome import Outcome
from takes import Project

from tests.support.driven_window import drive
from tests.support.x_server import x_server

AT_ONCE = 25
"""Paths that one window shows; all but the last few are opened over another one."""


def attack(project: Project, share: float, outcome: Outcome) -> None:
    """Half of the paths are streams, half are takes."""
    if shutil.which("Xvfb") is None:
        outcome.note("no Xvfb here: not run")
        return
    folder = project.folder / "window"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    paths = []
    files = read_stream(project.finished / "stream")
    for number in range(max(4, round(100 * share))):
        path = folder / f"{number:03}"
        if number % 2:
            for name, data in mutate(files, number)[1].items():
                target = path / name
                target.parent.mkdir(parents=True, exist_ok=True)
                target.write_bytes(data)
        else:
            shutil.copytree(project.finished, path)
            damage(path, number)
        paths.append(path)
    with x_server() as display:
        for first in range(0, len(paths), AT_ONCE):
            judge(display, paths[first : first + AT_ONCE], folder / f"window{first}", outcome)


def damage(take: Path, number: int) -> Path:
    """Change a file of a take; every kind of file is as likely as others, however many there are."""
    random_ = random.Random(number)
    kinds: dict[str, list[Path]] = {}
    for path in sorted(path for path in take.rglob("*") if path.is_file() and path.stat().st_size):
        name = "".join("0" if letter.isdigit() else letter for letter in path.relative_to(take).as_posix())
        kinds.setdefault(name if "files/" not in name else "files", []).append(path)
    chosen = random_.choice(kinds[random_.choice(sorted(kinds))])
    chosen.write_bytes(changed(chosen.read_bytes(), number))
    return chosen


def judge(display: str, paths: list[Path], folder: Path, outcome: Outcome) -> None:
    """A window shows the paths."""
    shown, errors, status = drive(display, paths, folder)
    outcome.count += len(shown)
    if len(shown) < len(paths):
        outcome.failed(f"the window ended with {status} at {paths[len(shown)].name}: {errors[-1500:]}")
    elif status:
        outcome.failed(f"the window ended with {status} after the last path: {errors[-1500:]}")
    for part in errors.split("== ")[1:]:
        if "Traceback" in part or "panicked" in part:
            outcome.failed(part[-1500:])
    for one in shown:
        bad = [text for text in one.sentences if len(text) > 6000 or any(ord(c) < 32 and c != "\n" for c in text)]
        bad += [text for text in one.sentences if "Error: " in text]
        if bad or one.dialog or (not one.opened and not one.sentences):
            outcome.failed(f"{one.path}: {one.dialog} {(bad or ['nothing was said'])[0][:500]!r}")
        for stage in one.unsettled:
            outcome.failed(f"{one.path}: {stage} drew nothing")
    opened = sum(one.opened for one in shown)
    outcome.note(f"{opened} opened, {len(shown) - opened} refused with a sentence")
