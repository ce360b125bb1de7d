"""Takes on a network file system, where each machine sees what others have written a while later."""

from __future__ import annotations

import random
import shutil
from pathlib import Path

from outcome import Outcome
from takes import Project, problems_of

from tests.support.warm_python import WarmProcess

FOREVER = 100_000
"""Seconds that no process of the attack lives for."""


def attack(project: Project, share: float, outcome: Outcome) -> None:
    """Workers that see each other's results late, and commands on takes of which they see a part."""
    workers(project, max(1, round(8 * share)), outcome)
    mixtures(project, max(1, round(40 * share)), outcome)


def workers(project: Project, count: int, outcome: Outcome) -> None:
    """Workers and a run at the same groups at the same time; none sees what the others write, for a while or for ever.

    In the end, the take must have the same bytes as an undisturbed one.
    """
    take, seen = project.folder / "late", project.folder / "late.seen"
    for number in range(count):
        for folder in (take, seen):
            shutil.rmtree(folder, ignore_errors=True)
        project.run("count", 0, take, "run", project.config, "--take", take, "--until", "calibrate")
        shutil.copytree(take, seen)
        seconds = (FOREVER, 1, 3, 10)[number % 4]
        group = [project.start("late", seconds, take, "work", take, "--group", index) for index in (0, 1, 0)]
        for process in [*group, project.start("late", seconds, take)]:
            outcome.count += 1
            judge(project.ended(process), f"{process.args[4:]}, {seconds} s late", outcome)
        finish(project, take, f"workers, {seconds} s late", outcome)


def mixtures(project: Project, count: int, outcome: Outcome) -> None:
    """Commands on a finished take of which each file is seen as it is, as it was in an earlier state, or not at all."""
    random_ = random.Random("late")
    take, seen, before = (project.folder / name for name in ("mix", "mix.seen", "mix.before"))
    shutil.rmtree(before, ignore_errors=True)
    # other frames are held out and the stream is coarser: other results under the same names
    changes = ("--train.finetune_iterations", "2", "--bake.qp", "40")
    earlier = project.run("count", 0, before, "run", project.config, "--take", before, *changes)
    assert earlier.returncode == 0, earlier.stderr
    for number in range(count):
        for folder in (take, seen):
            shutil.rmtree(folder, ignore_errors=True)
        shutil.copytree(project.finished, take)
        shutil.copytree(take, seen)
        hidden = mix(seen, before, random_)
        commands = (("check", take), ("status", take), ("work", take, "--group", number % 2), ())
        for command in (commands[number % 3], commands[3]):
            outcome.count += 1
            where = f"mixture {number}: {' '.join(map(str, command or ('run',)))}, {hidden} files late"
            judge(project.run("late", FOREVER, take, *command), where, outcome)
        finish(project, take, f"mixture {number}", outcome)


def mix(seen: Path, before: Path, random_: random.Random) -> int:
    """Make some files of `seen` those of an earlier state, or remove them; how many."""
    hidden, share = 0, random_.choice((0.1, 0.5, 0.9))
    for path in sorted(path for path in seen.rglob("*") if path.is_file()):
        if random_.random() > share:
            continue
        hidden += 1
        earlier = before / path.relative_to(seen)
        path.unlink()
        if earlier.is_file() and random_.random() < 0.5:
            shutil.copy2(earlier, path)
    return hidden


def judge(process: WarmProcess, where: str, outcome: Outcome) -> None:
    """A command must end well or with a sentence; `check` prints what it found, as that is its result."""
    error = str(process.stderr)
    said = error.strip() or str(process.stdout).strip()
    if process.returncode and ("Traceback" in error or not said):
        outcome.failed(f"{where}: exit {process.returncode}: {error[-1500:]}")
    elif process.returncode:
        outcome.note(f"{where}: {said.splitlines()[-1][:200]}")


def finish(project: Project, take: Path, where: str, outcome: Outcome) -> None:
    """A run that sees everything must give the same bytes."""
    for problem in problems_of(take):
        outcome.failed(f"{where}: {problem}")
    again = project.run("count", 0, take)
    if again.returncode != 0 or not project.same_results(take):
        outcome.failed(f"{where}: then {again.returncode}: {str(again.stderr)[-800:]}")
