"""How work on groups scales: measured on this machine in CPU seconds, and simulated on clusters.

    python benchmarks/scaling.py measure TAKE              # 1, 2 and 4 workers; what a group costs beside its work
    python benchmarks/scaling.py simulate TAKE [--groups 450] [--overhead 4] [--merge 60]

`measure` bakes the groups of a copy of a finished take with `v3studio work`, each in a process of its own. CPU
seconds depend little on what else runs on the machine; the speed-up is that of as many cores as workers: the CPU
seconds of all groups divided by those of the busiest worker.

`simulate` is a discrete-event simulation. The seconds of each frame are those that TAKE records of its groups, drawn
at random for each group; bytes are those of TAKE's footage and results. A group whose attempt fails, or whose node is
lost, starts again on the next free node and continues with the frame that was interrupted, as it does in a run.
"""

from __future__ import annotations

import argparse
import heapq
import itertools
import os
import random
import shutil
import subprocess
import sys
import tempfile
from collections import deque
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))


# Measured


def cpu_seconds(*words: str) -> float:
    """CPU seconds of a `v3studio` command."""
    process = subprocess.Popen(
        [sys.executable, "-m", "pipelines.cli", *words], cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
    )
    assert process.stderr is not None
    errors = process.stderr.read().decode(errors="replace")
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise RuntimeError(f"v3studio {' '.join(words)} failed: {errors[-500:]}")
    return used.ru_utime + used.ru_stime


def forget_stream(take: Path) -> None:
    """Delete what the stages from `bake` on have made."""
    for name in ("stream", ".v3studio/work/bake"):
        shutil.rmtree(take / name, ignore_errors=True)
    for name in ("bake", "evaluate"):
        (take / ".v3studio" / "stages" / f"{name}.json").unlink(missing_ok=True)


def measure(finished: Path) -> None:
    """Print the table of the speed-up and the parts of a group's costs."""
    with tempfile.TemporaryDirectory() as folder:
        measure_copy(Path(shutil.copytree(finished, Path(folder) / "take")))


def measure_copy(take: Path) -> None:
    """The same for a take that may be changed."""
    groups = len(list((take / "train").glob("group_*")))
    work = ("work", str(take), "--stage", "bake", "--group")
    print(f"{groups} groups; CPU seconds; load {os.getloadavg()[0]:.1f}")
    print("| workers | all groups | busiest worker | speed-up |\n|---|---|---|---|")
    alone = 0.0
    for workers in (1, 2, 4):
        forget_stream(take)
        spent = [0.0] * workers

        def run(worker: int, spent: list[float] = spent) -> None:
            for group in range(worker, groups, len(spent)):
                spent[worker] += cpu_seconds(*work, str(group))

        with ThreadPoolExecutor(workers) as pool:
            list(pool.map(run, range(workers)))  # raises what a worker raised
        alone = alone or sum(spent)
        print(f"| {workers} | {sum(spent):.1f} | {max(spent):.1f} | {sum(spent) / max(spent):.2f} |", flush=True)
    started = min(cpu_seconds(*work, "0") for _ in range(3))
    helped = min(cpu_seconds("--help") for _ in range(3))
    merged = cpu_seconds("run", "--take", str(take), "--until", "bake")
    print(f"a group: {alone / groups:.2f}, of which {started:.2f} before its work: start of the program {helped:.2f},")
    print(f"libraries, settings, footage and earlier results {started - helped:.2f}")
    print(f"merge of {groups} groups into the stream, with the start of the program: {merged:.2f}")


# Simulated


@dataclass(frozen=True)
class Cluster:
    """What is simulated.

    Attributes:
        name: for the table.
        gpus: nodes, with one GPU each.
        failing: probability that an attempt on a group fails, at any time of it.
        lost_per_hour: how often a node is lost, each; another one replaces it after `replaced_after` seconds.
        slow: how many nodes take twice as long.
    """

    name: str
    gpus: int
    failing: float = 0.0
    lost_per_hour: float = 0.0
    slow: int = 0
    replaced_after: float = 300.0


@dataclass
class Costs:
    """Of one group.

    Attributes:
        frames: seconds of each frame, for each group of the take that they are from.
        overhead: seconds before the work of each attempt.
        bytes_in: footage of a frame.
        bytes_out: results of a frame.
    """

    frames: list[list[float]]
    overhead: float
    bytes_in: float
    bytes_out: float


@dataclass
class Outcome:
    """Of a simulation: seconds until the last group is done, seconds of work that counted, attempts, bytes."""

    makespan: float = 0.0
    work: float = 0.0
    attempts: int = 0
    moved: float = 0.0


@dataclass
class _Group:
    """Seconds of its frames that are not finished."""

    left: list[float]


def simulate(cluster: Cluster, costs: Costs, groups: int, seed: int) -> Outcome:
    """Work through `groups` groups, in order of their numbers; those that were interrupted come first."""
    chance, found = random.Random(seed), Outcome()
    queue = deque(_Group(list(chance.choice(costs.frames))) for _ in range(groups))
    found.work = sum(sum(group.left) for group in queue)
    speeds = [0.5 if node < cluster.slow else 1.0 for node in range(cluster.gpus)]
    free = deque(range(cluster.gpus))
    number = itertools.count()
    events: list[tuple[float, int, int, _Group | None]] = []  # time, order, node, the group to put back
    now = 0.0
    while True:
        while queue and free:
            _start(cluster, costs, queue.popleft(), free.popleft(), now, speeds, chance, events, number, found)
        if not events:
            return found
        now, _, node, group = heapq.heappop(events)
        if node >= 0:
            free.append(node)
        if group is not None:
            queue.appendleft(group)


def _start(
    cluster: Cluster,
    costs: Costs,
    group: _Group,
    node: int,
    now: float,
    speeds: Sequence[float],
    chance: random.Random,
    events: list[tuple[float, int, int, _Group | None]],
    number: itertools.count[int],
    found: Outcome,
) -> None:
    """An attempt: puts its end, or what interrupts it, into the events."""
    found.attempts += 1
    seconds = [one / speeds[node] for one in group.left]
    length = costs.overhead + sum(seconds)
    found.moved += costs.bytes_in * len(seconds)
    lost = chance.expovariate(cluster.lost_per_hour / 3600) if cluster.lost_per_hour else float("inf")
    failed = chance.uniform(0, length) if chance.random() < cluster.failing else float("inf")
    stop = min(lost, failed, length)
    done, spent = 0, costs.overhead
    while done < len(seconds) and spent + seconds[done] <= stop + 1e-9:
        spent += seconds[done]
        done += 1
    found.moved += costs.bytes_out * done
    if stop == length:
        found.makespan = max(found.makespan, now + length)
        heapq.heappush(events, (now + length, next(number), node, None))
        return
    rest = _Group(group.left[done:])
    if lost <= failed:
        heapq.heappush(events, (now + stop, next(number), -1, rest))
        heapq.heappush(events, (now + stop + cluster.replaced_after, next(number), node, None))
    else:
        heapq.heappush(events, (now + stop, next(number), node, rest))


def costs_of(take: Path, overhead: float) -> Costs:
    """Costs as a finished take records them."""
    from pipelines.config import load_config
    from pipelines.takes.atomic_files import read_model
    from pipelines.takes.stage_files import TrainedGroup
    from pipelines.takes.take import Take

    opened = Take.open(take)
    notes = [read_model(path, TrainedGroup) for path in sorted((take / "train").glob("group_*/group.json"))]
    frames = sum(len(note.frames) for note in notes)
    root = load_config(opened.config).capture.root
    footage = sum(path.stat().st_size for path in root.rglob("*") if path.is_file())
    results = sum(path.stat().st_size for path in (take / "train").rglob("*.safetensors"))
    return Costs([list(note.seconds) for note in notes], overhead, footage / frames, results / frames)


def print_simulation(take: Path, groups: int, overhead: float, merge: float, seed: int) -> None:
    """Print a row per cluster; `merge` is added to each makespan."""
    costs = costs_of(take, overhead)
    one = sum(map(sum, costs.frames)) / len(costs.frames)
    print(f"{groups} groups of {len(costs.frames[0])} frames, {one:.0f} s each; {overhead:g} s before an attempt,")
    inward, outward = costs.bytes_in / 1e6, costs.bytes_out / 1e6
    print(f"{merge:g} s at the end; footage {inward:.2f} MB and results {outward:.2f} MB a frame")
    print("| GPUs | what happens | makespan | efficiency | attempts | GB moved |\n|---|---|---|---|---|---|")
    for gpus in (8, 64, 450):
        for cluster in (
            Cluster("nothing", gpus),
            Cluster("1% of attempts fail", gpus, failing=0.01),
            Cluster("each node is lost once in 10 hours", gpus, lost_per_hour=0.1),
            Cluster("one node at half speed", gpus, slow=1),
            Cluster("all of these", gpus, failing=0.01, lost_per_hour=0.1, slow=1),
        ):
            found = simulate(cluster, costs, groups, seed)
            total = found.makespan + merge
            print(
                f"| {gpus} | {cluster.name} | {int(total) // 3600} h {int(total) % 3600 // 60:02d} min | "
                f"{found.work / (gpus * total):.0%} | {found.attempts} | {found.moved / 1e9:.1f} |"
            )


def main() -> None:
    """Measure or simulate."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    kinds = parser.add_subparsers(required=True, dest="kind")
    one = kinds.add_parser("measure")
    one.add_argument("take", type=Path, help="finished take, which stays as it is")
    two = kinds.add_parser("simulate")
    two.add_argument("take", type=Path)
    two.add_argument("--groups", type=int, default=450)
    two.add_argument("--overhead", type=float, default=4.0, help="seconds before the work of an attempt")
    two.add_argument("--merge", type=float, default=60.0, help="seconds at the end")
    two.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    if arguments.kind == "measure":
        measure(arguments.take.absolute())
    else:
        print_simulation(
            arguments.take.absolute(), arguments.groups, arguments.overhead, arguments.merge, arguments.seed
        )


if __name__ == "__main__":
    main()
