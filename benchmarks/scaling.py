"""How baking scales with workers, and what a group costs beside its work, in CPU seconds on this machine.

    python benchmarks/scaling.py TAKE              # a finished take; 1, 2 and 4 workers

Bakes the groups of a copy of the take with `v3studio work`, each in a process of its own. CPU seconds depend little on
what else runs on the machine; the speed-up is that of as many cores as workers: the CPU seconds of all groups divided
by those of the busiest worker.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


def cpu_seconds(*words: str) -> float:
    """CPU seconds of a `v3studio` command."""
    command = [sys.executable, "-m", "v3studio.pipelines.cli", *words]
    process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
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


def measure(take: Path) -> None:
    """Print the table of the speed-up and the parts of a group's costs; changes the take."""
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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("take", type=Path, help="finished take, which stays as it is")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        measure(Path(shutil.copytree(arguments.take.absolute(), Path(folder) / "take")))


if __name__ == "__main__":
    main()
