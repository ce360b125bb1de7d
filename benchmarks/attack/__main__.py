"""Attacks V3 Studio on this machine, and prints a table of what was tried, promised and found.

    python benchmarks/attack [--parts kills,full,...] [--share 0.01]

`--share` scales the counts. Everything is bounded in time and memory. Exit code 1 if a promise was broken.
"""

import argparse
import sys
import tempfile
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
