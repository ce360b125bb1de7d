"""Attacks V3 Studio on this machine, and prints a table of what was tried, promised and found.

    python benchmarks/attack [--parts kills,full,...] [--share 0.01] [--folder DIR]

`--share` scales the counts. Everything is bounded in time and memory. Exit code 1 if a promise was broken.
"""

import argparse
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parents[1]), str(HERE.parent), str(HERE)]

import takes  # noqa: E402
from takes import Outcome  # noqa: E402


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--parts", default=",".join(PARTS), help="which, separated by commas; default: all")
    parser.add_argument("--share", type=float, default=1.0, help="of the full counts")
    parser.add_argument("--folder", type=Path, help="for the takes; default: a temporary one")
    options = parser.parse_args()
    outcomes: list[Outcome] = []
    with tempfile.TemporaryDirectory() as temporary:
        folder = options.folder or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        for name in options.parts.split(","):
            promised, attack = PARTS[name]
            outcome = Outcome(name, promised)
            outcomes.append(outcome)
            attack(folder, options.share, outcome)
            print(f"{outcome.row()}  {time.monotonic() - outcome.began:.0f} s", flush=True)
    print("\n| Part | Count | Promised | Happened |\n|---|---|---|---|")
    for outcome in outcomes:
        print(outcome.row())
    return 1 if any(outcome.wrong for outcome in outcomes) else 0


_projects: dict[Path, takes.Project] = {}


def project_in(folder: Path) -> takes.Project:
    """The tiny project that all attacks on takes share."""
    if folder not in _projects:
        (folder / "project").mkdir()
        _projects[folder] = takes.Project(folder / "project")
    return _projects[folder]


def writes(kind: str) -> Callable[[Path, float, Outcome], None]:
    """The attack that goes through all writes."""
    return lambda folder, share, outcome: takes.at_every_write(
        project_in(folder), kind, max(2, round(1000 * share)), outcome
    )


def cuts(kind: str, count: int) -> Callable[[Path, float, Outcome], None]:
    """The attack at random writes, on this many takes."""
    return lambda folder, share, outcome: takes.random_cuts(
        project_in(folder), kind, max(1, round(count * share)), outcome
    )


PARTS: dict[str, tuple[str, Callable[[Path, float, Outcome], None]]] = {
    "kills": ("the take opens, finished frames stay, the same bytes in the end", writes("kill")),
    "two-kills": ("the same: each take is killed twice, at random writes", cuts("kill", 25)),
    "full": ("a sentence, finished frames stay, the same bytes in the end", writes("full")),
    "power": ("the take opens or says what is damaged; the same bytes in the end", cuts("power", 40)),
    "small-files": (
        "a sentence; the same bytes without the limit",
        lambda folder, share, outcome: takes.small_files(project_in(folder), outcome),
    ),
}

if __name__ == "__main__":
    sys.exit(main())
