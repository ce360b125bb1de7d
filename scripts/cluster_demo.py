"""Runs the sample capture on a Ray cluster of two nodes on this machine, kills one of them in the middle of training,
and compares the result with that of a local run.

    python scripts/cluster_demo.py TAKE --compare DEMO_TAKE [settings]

TAKE is the take to make. DEMO_TAKE is one that was made from sample_configs/demo.yaml with the same settings: groups of
at most 15 frames, so that both nodes have one. The exit code is 1 if a trained frame, a file of the stream or
evaluation.json differs.
"""

import argparse
import os
import shutil
import subprocess
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from tests.support.two_nodes import SETTINGS, two_nodes
from v3studio.pipelines.events import GroupStarted, Warned
from v3studio.studio.process import python_command

ROOT = Path(__file__).resolve().parents[1]


def run(take: Path, settings: list[str]) -> None:
    """Run the take and kill the second node when it has trained a frame."""
    lost = False
    with two_nodes(max(1, (os.cpu_count() or 2) // 2)) as cluster:
        print(f"A cluster of two nodes is running at {cluster.address}.")
        command = python_command("v3studio.pipelines.cli", "run", "sample_configs/demo.yaml", "--take", str(take))
        command += ["--json", "--run.executor", "ray", "--run.address", cluster.address, *settings]
        process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True, env={**os.environ, **SETTINGS})
        assert process.stdout is not None
        for event in cluster.events_while_second_is_killed(process.stdout):
            if isinstance(event, GroupStarted):
                print(f"{event.stage}: group {event.group} started on {event.node}", flush=True)
            elif isinstance(event, Warned):
                print(f"warning: {event.message}", flush=True)
                lost |= event.code == "cluster.worker_lost"
        if process.wait():
            raise SystemExit("The run failed.")
    if not lost:
        raise SystemExit("The run ended before the second node could be killed.")


def differences(take: Path, other: Path) -> list[str]:
    """Names of the files whose bytes differ."""
    digests = [
        {
            path.relative_to(root): path.read_bytes()
            for pattern in ("train/*/frame_*.safetensors", "stream/**/*", "evaluation.json")
            for path in root.glob(pattern)
            if path.is_file()
        }
        for root in (take, other)
    ]
    print(f"Comparing {len(digests[0])} files with {other}.")
    ours, theirs = digests
    return sorted(str(name) for name in ours.keys() | theirs.keys() if ours.get(name) != theirs.get(name))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("take", type=Path)
    parser.add_argument("--compare", type=Path, required=True, help="take of a local run")
    arguments, settings = parser.parse_known_args()
    shutil.rmtree(arguments.take, ignore_errors=True)
    run(arguments.take.absolute(), settings)
    wrong = differences(arguments.take, arguments.compare)
    print("\n".join(f"differs: {name}" for name in wrong) or "All bytes are equal.")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
