"""Attacks V3 Studio on this machine, and prints a table of attacks, promises and results.

    python benchmarks/attack [--parts kills,full,...] [--share 0.01]

Runs of a tiny take meet kills, full disks and power cuts at writes, and files that cannot grow. `--share` scales the
counts. Everything is bounded in time and memory. Exit code 1 if a promise was broken.
"""

import argparse
import hashlib
import random
import shutil
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from tests.support.tiny_capture import ROOT, SETTINGS, environment, write_capture
from tests.support.warm_python import WarmProcess, warm_python
from v3studio.pipelines.takes.take import Take
from v3studio.studio.errors import StudioError
from v3studio.studio.stream import StreamReader, check_stream

FAULTS = ROOT / "benchmarks" / "attack" / "faults.py"
PATIENCE = 600.0  # seconds that a run may take before it counts as hanging; the machine may be busy

QUICKER = {
    "group_size: 3": "group_size: 2",
    "keyframe_iterations: 25": "keyframe_iterations: 12",
    "densify_from: 5": "densify_from: 2",
    "densify_until: 15": "densify_until: 4",
    "densify_every: 5": "densify_every: 2",
    "motion_iterations: 10": "motion_iterations: 2",
    "finetune_iterations: 20": "finetune_iterations: 3",
    "points: 400": "points: 200",
    "prune_finetune_iterations: 5": "prune_finetune_iterations: 1",
}


@dataclass
class Outcome:
    """Counts attempts and collects what was wrong."""

    name: str  # the part
    promised: str  # what must hold, in a few words
    count: int = 0  # attempts
    broken: int = 0  # promises
    notes: list[str] = field(default_factory=list)  # what happened that is no fault, such as what was refused

    def failed(self, line: str) -> None:
        """Count, and print, a broken promise."""
        self.broken += 1
        print(f"{self.name}: WRONG: {line}", flush=True)

    def row(self) -> str:
        """A row of a Markdown table."""
        happened = f"{self.broken} broken" if self.broken else "kept"
        notes = "; ".join(self.notes[:3])
        return f"| {self.name} | {self.count:,} | {self.promised} | {happened}{'; ' + notes if notes else ''} |"


class Project:
    """A capture of three frames, its settings, and a finished take to compare with."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        write_capture(folder / "capture", 3)
        settings = SETTINGS
        for before, after in QUICKER.items():
            settings = settings.replace(before, after)
        self.config = folder / "ball.yaml"
        self.config.write_text(settings + "bake: {preset: ultrafast}\n")
        self.finished = folder / "finished"
        ended = self.run("count", 0, self.finished)
        assert ended.returncode == 0, ended.stderr
        self.writes = int((folder / "finished.writes").read_text())
        self.run("count", 0, self.finished)
        self.idle_writes = int((folder / "finished.writes").read_text())

    def run(self, kind: str, number: int, take: Path) -> WarmProcess:
        """A run with a fault, at its end; its errors are in `stderr`."""
        words = (FAULTS, kind, number, take, "run", self.config, "--take", take)
        process = warm_python().popen(words, text=True, cwd=ROOT, env=environment())
        process.stdout, process.stderr = process.communicate(PATIENCE)
        return process

    def same_results(self, take: Path) -> bool:
        """Return whether stream and trained frames are those of the undisturbed run, byte for byte."""
        return results(take) == results(self.finished)


def results(take: Path) -> dict[str, str]:
    """SHA-256 of the finished results by path: trained frames and the stream."""
    files = [*take.glob("train/*/frame_*.safetensors"), *(path for path in take.glob("stream/**/*") if path.is_file())]
    return {path.relative_to(take).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


def problems_of(take: Path, before: dict[str, str] | None = None) -> list[str]:
    """The faults of a take: it does not open, its stream is torn, a finished frame has changed."""
    problems = []
    try:
        if (take / "take.json").exists():
            Take.open(take)
        if (take / "stream" / "manifest.json").exists():
            with StreamReader.open(take / "stream") as reader:
                problems += [f"{damage.file}: {damage.problem}" for damage in check_stream(reader).damage]
    except StudioError as error:
        problems.append(str(error))
    now = results(take)
    lost = [name for name, digest in (before or {}).items() if name.startswith("train/") and now.get(name) != digest]
    return problems + [f"{name} was finished and has changed" for name in lost]


def at_every_write(kind: str, project: Project, share: float, outcome: Outcome) -> None:
    """`kill` or `full` at one write after the other, each run going on from where the last one failed.

    As soon as a run leaves a new result, the next one begins with the first write after those that every run makes.
    """
    take = project.folder / kind
    shutil.rmtree(take, ignore_errors=True)
    number = 1
    for _ in range(max(2, round(1000 * share))):
        before = results(take)
        ended = project.run(kind, number, take)
        outcome.count += 1
        error = str(ended.stderr)
        where = f"{kind} at write {number}, with {len(before)} results"
        if ended.returncode == 0:
            break
        if kind == "kill" and ended.returncode != -9:
            outcome.failed(f"{where}: exit {ended.returncode}: {error[-600:]}")
        said = "disk is full" in error or "No space left" in error
        if kind == "full" and ("Traceback" in error or not said):
            outcome.failed(f"{where}: {error[-600:]}")
        for problem in problems_of(take, before):
            outcome.failed(f"{where}: {problem}")
        number = max(1, project.idle_writes - 2) if len(results(take)) > len(before) else number + 1
    ended = project.run("count", 0, take)
    if ended.returncode != 0 or not project.same_results(take):
        outcome.failed(f"{kind}: in the end exit {ended.returncode}, other bytes: {str(ended.stderr)[-600:]}")


def random_cuts(kind: str, count: int, project: Project, share: float, outcome: Outcome) -> None:
    """Takes whose first run is killed at a random write, and whose second run ends with `kind`: killed again, or by a
    power cut that loses all that it has not synced. The third must give the same bytes."""
    random_ = random.Random(kind)
    take = project.folder / "cut"
    killed = empty = 0
    for _ in range(max(1, round(count * share))):
        shutil.rmtree(take, ignore_errors=True)
        kept = random_.randint(1, project.writes - 1)
        killed += project.run("kill", kept, take).returncode == -9
        number = random_.randint(1, project.writes - kept + project.idle_writes)
        before = results(take)
        ended = project.run(kind, number, take)
        killed += ended.returncode == -9
        outcome.count += 1
        where = f"{kind} at write {number} after {kept}"
        manifest = take / "stream" / "manifest.json"
        empty += manifest.exists() and not manifest.stat().st_size
        for problem in problems_of(take, before if kind == "kill" else None):
            (outcome.failed if kind == "kill" else outcome.notes.append)(f"{where}: {problem}")
        again = project.run("count", 0, take)
        if again.returncode != 0 or not project.same_results(take):
            outcome.failed(f"{where} ({ended.returncode}): then {again.returncode}: {str(again.stderr)[-800:]}")
    if empty:
        outcome.failed(f"{empty} empty manifests")
    outcome.notes.insert(0, f"{killed} runs were killed, {empty} manifests were empty")


def small_files(project: Project, share: float, outcome: Outcome) -> None:
    """Files that cannot grow beyond a size, as with a quota: also the writes of native libraries fail."""
    sizes = (0, 100, 1000, 2000, 4000, 8000, 16000, 32000)
    for size in sizes[: max(1, round(len(sizes) * share))]:
        take = project.folder / "size"
        shutil.rmtree(take, ignore_errors=True)
        ended = project.run("size", size, take)
        outcome.count += 1
        if ended.returncode == 0 and not project.same_results(take):
            outcome.failed(f"files of {size} bytes: exit 0 with other results")
        if ended.returncode != 0 and ("Traceback" in str(ended.stderr) or not str(ended.stderr).strip()):
            outcome.failed(f"files of {size} bytes: exit {ended.returncode}: {str(ended.stderr)[-600:]}")
        again = project.run("count", 0, take)
        if again.returncode != 0 or not project.same_results(take):
            outcome.failed(f"files of {size} bytes, then without a limit: {str(again.stderr)[-600:]}")


PARTS: dict[str, tuple[str, Callable[[Project, float, Outcome], None]]] = {
    "kills": ("the take opens, finished frames stay, the same bytes in the end", partial(at_every_write, "kill")),
    "two-kills": ("the same: each take is killed twice, at random writes", partial(random_cuts, "kill", 25)),
    "full": ("a sentence, finished frames stay, the same bytes in the end", partial(at_every_write, "full")),
    "power": ("the take opens or says what is damaged; the same bytes in the end", partial(random_cuts, "power", 40)),
    "small-files": ("a sentence; the same bytes without the limit", small_files),
}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--parts", default=",".join(PARTS), help="which, separated by commas; default: all")
    parser.add_argument("--share", type=float, default=1.0, help="of the full counts")
    options = parser.parse_args()
    broken = 0
    print("| Part | Count | Promised | Happened |\n|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        project = Project(Path(folder))
        for name in options.parts.split(","):
            promised, attack = PARTS[name]
            outcome = Outcome(name, promised)
            attack(project, options.share, outcome)
            print(outcome.row(), flush=True)
            broken += outcome.broken
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
