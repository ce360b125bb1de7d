"""Attacks V3 Studio on this machine, and prints a table of what was tried, promised and found.

    python benchmarks/attack [--parts kills,full,...] [--share 0.01]

`--share` scales the counts. Everything is bounded in time and memory. Exit code 1 if a promise was broken.
"""

import argparse
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from takes import Outcome, Project, at_every_write, random_cuts, small_files

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
    outcomes: list[Outcome] = []
    with tempfile.TemporaryDirectory() as folder:
        project = Project(Path(folder))
        for name in options.parts.split(","):
            promised, attack = PARTS[name]
            outcome = Outcome(name, promised)
            outcomes.append(outcome)
            attack(project, options.share, outcome)
            print(f"{outcome.row()}  {time.monotonic() - outcome.began:.0f} s", flush=True)
    print("\n| Part | Count | Promised | Happened |\n|---|---|---|---|")
    for outcome in outcomes:
        print(outcome.row())
    return 1 if any(outcome.wrong for outcome in outcomes) else 0


if __name__ == "__main__":
    sys.exit(main())
