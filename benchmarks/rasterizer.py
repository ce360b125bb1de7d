"""Speed of the rasterizer, compared with its goals and with other implementations.

    python benchmarks/rasterizer.py            # about two minutes on two cores
    python benchmarks/rasterizer.py --quick    # only a few repetitions
    python benchmarks/rasterizer.py --json results.json
    python benchmarks/rasterizer.py --opensplat DIR   # a checkout of OpenSplat, whose CPU rasterizer is timed, too

Times are medians over repetitions and wall-clock times unless labeled as CPU time. Ratios compare times of the same
run; OpenSplat and ours take turns, each with one thread.

The scene is a person-like surface: an ellipsoid of 0.6 x 1.7 x 0.4 m, seen so that 2 m fill 90% of the image height.
Its splats have a radius of 2 to 4 pixels (at which alpha falls to 1/255) and SH degree 3.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import platform
import resource
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))
os.environ.setdefault("OMP_WAIT_POLICY", "passive")  # see studio.process; read when torch is imported

import numpy as np
import torch
from rich.console import Console
from rich.table import Table

from studio.cameras import Camera
from studio.gaussians import Gaussians
from studio.json_types import JsonObject
from studio.rasterizer import available_backends, preferred_device, rasterize
from studio.rasterizer.cpu import load_kernels
from studio.rasterizer.reference import project, visible_radii
from studio.rasterizer.types import ALPHA_MAX, ALPHA_MIN, TRANSMITTANCE_MIN, Pinhole
from studio.training.photometric import photometric_loss

FORWARD_FLOPS, BACKWARD_FLOPS = 35, 55
"""Floating-point operations per blended (pixel, splat) pair, counted in csrc/blend.h and csrc/backward.h."""

console = Console(width=112)


def person(count: int, width: int, height: int, device: str = "cpu", seed: int = 0) -> tuple[Gaussians, Camera]:
    """Splats on an ellipsoid, and a camera that sees all of it."""
    generator = torch.Generator().manual_seed(seed)

    def normal(*shape: int) -> torch.Tensor:
        return torch.randn(*shape, generator=generator)

    direction = torch.nn.functional.normalize(normal(count, 3), dim=-1)
    focal = 1.1 * width
    distance = focal * 2.0 / (0.9 * height)
    sigma = 0.72 * distance / focal  # alpha falls to 1/255 at about 3 px, including dilation and opacity
    splats = Gaussians(
        means=direction * torch.tensor([0.3, 0.85, 0.2]),
        quats=normal(count, 4),
        log_scales=math.log(sigma) + 0.4 * normal(count, 3),
        logit_opacities=1.0 + normal(count),
        sh=0.15 * normal(count, 16, 3),
    )
    pose = np.eye(4)
    pose[2, 3] = distance
    K = np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1]])
    return splats.to(device), Camera("front", width, height, K, pose)


def leaves(splats: Gaussians) -> Gaussians:
    return splats.map(lambda tensor: tensor.detach().clone().requires_grad_())


def time_it(function: Callable[[], Any], repeat: int, device: str = "cpu") -> tuple[float, float]:
    """Medians in milliseconds: wall-clock time, and CPU time of this thread (less affected by other programs)."""
    wait = torch.cuda.synchronize if device == "cuda" else lambda: None
    for _ in range(3):
        function()
    wait()
    wall, cpu = [], []
    for _ in range(repeat):
        start, cpu_start = time.perf_counter(), time.thread_time()
        function()
        wait()
        wall.append(time.perf_counter() - start)
        cpu.append(time.thread_time() - cpu_start)
    return 1e3 * statistics.median(wall), 1e3 * statistics.median(cpu)


def forward_function(splats: Gaussians, camera: Camera, backend: str = "auto") -> Callable[[], Any]:
    def run() -> Any:
        with torch.no_grad():
            return rasterize(splats, camera, backend=backend)

    return run


def both_function(splats: Gaussians, camera: Camera, backend: str = "auto") -> Callable[[], Any]:
    trained = leaves(splats)
    upstream = torch.randn(camera.height, camera.width, 3, device=splats.device)

    def run() -> None:
        torch.autograd.backward(rasterize(trained, camera, backend=backend).image, upstream)
        for _, tensor in trained.items():
            tensor.grad = None

    return run


def mark(value: float, goal: float) -> str:
    return f"[green]yes[/] (< {goal:g})" if value < goal else f"[red]no[/] (< {goal:g})"


def in_turn(ours: Callable[[], Any], theirs: Callable[[], Any], turns: int) -> tuple[float, float]:
    """Medians of the CPU time of this thread in milliseconds, each side once per turn."""
    times: tuple[list[float], list[float]] = ([], [])
    for turn in range(turns + 1):
        for function, found in zip((ours, theirs), times, strict=True):
            start = time.thread_time()
            function()
            if turn:  # the first one warms up
                found.append(1e3 * (time.thread_time() - start))
    return statistics.median(times[0]), statistics.median(times[1])


def speed_table(repeat: int, results: JsonObject) -> None:
    table = Table(title="CPU kernels, person-like surface, milliseconds (median)")
    for name in ("image", "splats", "threads", "forward", "fwd + bwd", "CPU, 1 thread", "2 threads"):
        table.add_column(name, justify="right")
    results["speed"] = []
    for width, height in ((480, 270), (960, 540)):
        for count in (5_000, 30_000, 100_000):
            splats, camera = person(count, width, height)
            single = None
            for threads in (1, 2):
                torch.set_num_threads(threads)
                forward, _ = time_it(forward_function(splats, camera), repeat)
                both, cpu = time_it(both_function(splats, camera), repeat)
                single = both if threads == 1 else single
                assert single is not None
                table.add_row(
                    f"{width}x{height}",
                    f"{count}",
                    f"{threads}",
                    f"{forward:.1f}",
                    f"{both:.1f}",
                    f"{cpu:.1f}" if threads == 1 else "",
                    f"x{single / both:.2f}" if threads == 2 else "",
                )
                results["speed"].append(
                    {"width": width, "splats": count, "threads": threads, "forward_ms": forward, "both_ms": both,
                     "both_cpu_ms": cpu if threads == 1 else None}
                )  # fmt: skip
    console.print(table)


def goals_table(repeat: int, results: JsonObject) -> None:
    torch.set_num_threads(2)
    table = Table(title="Goals for the viewport and for a single thread, milliseconds (median)")
    for name in ("what", "threads", "wall", "reached"):
        table.add_column(name)
    results["goals"] = []
    cases = (
        ("forward, 60k splats, 960x540", 2, 60_000, 960, 540, False, 33.0),
        ("forward, 100k splats, 1280x720", 2, 100_000, 1280, 720, False, 50.0),
        ("forward and backward, 30k splats, 480x270", 1, 30_000, 480, 270, True, 20.0),
    )
    for what, threads, count, width, height, backward, goal in cases:
        torch.set_num_threads(threads)
        splats, camera = person(count, width, height)
        make = both_function if backward else forward_function
        wall, _ = time_it(make(splats, camera), repeat)
        table.add_row(what, f"{threads}", f"{wall:.1f}", mark(wall, goal))
        results["goals"].append({"what": what, "threads": threads, "wall_ms": wall, "goal_ms": goal})
    console.print(table)


def iteration_table(repeat: int, results: JsonObject, device: str, count: int, width: int, height: int) -> None:
    table = Table(title=f"Training iteration on {device}: {count} splats, SH degree 3, {width}x{height} (median ms)")
    for name in ("threads", "render", "L1 + D-SSIM", "backward", "Adam", "total", "per second", "slowest part"):
        table.add_column(name, justify="right")
    results[f"iteration_{device}"] = []
    for threads in (1, 2) if device == "cpu" else (torch.get_num_threads(),):
        torch.set_num_threads(threads)
        splats, camera = person(count, width, height, device)
        with torch.no_grad():
            target = rasterize(person(count, width, height, device, seed=1)[0], camera).image.clamp(0, 1)
        trained = leaves(splats)
        groups = [{"params": [tensor]} for _, tensor in trained.items()]
        adam = torch.optim.Adam(groups, lr=1e-4, eps=1e-15, fused=True)
        wait = torch.cuda.synchronize if device == "cuda" else lambda: None
        parts: dict[str, list[float]] = {"render": [], "loss": [], "backward": [], "Adam": []}
        whole = []
        for step in range(repeat + 3):
            wait()
            marks = [time.perf_counter()]

            def lap(marks: list[float] = marks, wait: Callable[[], Any] = wait) -> None:
                wait()
                marks.append(time.perf_counter())

            image = rasterize(trained, camera).image
            lap()
            loss = photometric_loss(image, target)
            lap()
            loss.backward()
            lap()
            adam.step()
            adam.zero_grad(set_to_none=True)
            lap()
            if step >= 3:
                for name, start, end in zip(parts, marks, marks[1:], strict=False):
                    parts[name].append(1e3 * (end - start))
                whole.append(1e3 * (marks[-1] - marks[0]))
        medians = {name: statistics.median(values) for name, values in parts.items()}
        total = statistics.median(whole)
        most = max(medians, key=lambda name: medians[name])
        rate = 1e3 / total
        good = f"[green]{rate:.0f}[/]" if rate >= 20 else f"[red]{rate:.0f}[/]"
        share = f"{most} ({100 * medians[most] / total:.0f}%)"
        table.add_row(f"{threads}", *(f"{value:.1f}" for value in medians.values()), f"{total:.1f}", good, share)
        results[f"iteration_{device}"].append({"threads": threads, "whole_ms": total, **medians})
    console.print(table)


def blended_pairs(splats: Gaussians, camera: Camera) -> int:
    """Number of (pixel, splat) pairs that contribute to the image, counted with the formulas of the reference."""
    pinhole = Pinhole.of(camera)
    half, depths, _ = visible_radii(splats, pinhole, None, 0.01)
    index = torch.nonzero(half[:, 0] > 0)[:, 0]
    index = index[torch.argsort(depths[index], stable=True)]
    half = half[index]
    means2d, cov2d, det, _, _ = project(splats[index], pinhole)
    opacities = splats.opacities[index]
    low, high = means2d - half, means2d + half
    pairs, side = 0, 16
    for top in range(0, camera.height, side):
        in_row = (high[:, 1] > top) & (low[:, 1] < top + side)
        for left in range(0, camera.width, side):
            here = torch.nonzero(in_row & (high[:, 0] > left) & (low[:, 0] < left + side))[:, 0]
            ys, xs = torch.meshgrid(torch.arange(side) + top + 0.5, torch.arange(side) + left + 0.5, indexing="ij")
            inside = ((xs < camera.width) & (ys < camera.height)).reshape(-1, 1)
            dx, dy = xs.reshape(-1, 1) - means2d[here, 0], ys.reshape(-1, 1) - means2d[here, 1]
            c = cov2d[here]
            sigma = (c[:, 2] * dx * dx - 2 * c[:, 1] * dx * dy + c[:, 0] * dy * dy) / (2 * det[here])
            alpha = (opacities[here] * torch.exp(-sigma)).clamp_max(ALPHA_MAX)
            alpha = torch.where((alpha >= ALPHA_MIN) & inside, alpha, 0.0)
            through = torch.cumprod(1 - alpha, dim=1)
            pairs += int(((alpha > 0) & (through > TRANSMITTANCE_MIN)).sum())
    return pairs


def limits_table(repeat: int, results: JsonObject) -> None:
    torch.set_num_threads(1)
    size = 1536
    a, b = torch.randn(size, size), torch.randn(size, size)
    _, cpu = time_it(lambda: a @ b, max(5, repeat // 3))
    peak = 2 * size**3 / (cpu * 1e-3)
    table = Table(title=f"Fraction of the machine's peak: one thread, sgemm reaches {peak / 1e9:.0f} GFLOP/s")
    for name in ("pass", "blended pairs", "CPU ms", "pairs per second", "GFLOP/s in pairs", "of the peak"):
        table.add_column(name, justify="right")
    splats, camera = person(30_000, 480, 270)
    pairs = blended_pairs(splats, camera)
    _, forward = time_it(forward_function(splats, camera), repeat)
    _, both = time_it(both_function(splats, camera), repeat)
    results["limit"] = {"sgemm_flops": peak, "pairs": pairs}
    for name, milliseconds, flops in (
        ("forward", forward, FORWARD_FLOPS),
        ("forward and backward", both, FORWARD_FLOPS + BACKWARD_FLOPS),
    ):
        rate = pairs / (milliseconds * 1e-3)
        table.add_row(
            name, f"{pairs}", f"{milliseconds:.1f}", f"{rate / 1e6:.0f} M", f"{rate * flops / 1e9:.1f}",
            f"{100 * rate * flops / peak:.0f}%",
        )  # fmt: skip
        results["limit"][name] = {"pairs_a_second": rate, "share_of_peak": rate * flops / peak}
    console.print(table)
    console.print(
        "Only pairs that contribute to the image are counted. The time also includes projection, spherical harmonics, "
        "sorting, and pairs that turn out to be too transparent or occluded."
    )


def reference_table(repeat: int, results: JsonObject) -> None:
    torch.set_num_threads(1)
    splats, camera = person(5_000, 480, 270)
    table = Table(title="Compared with the torch reference: 5k splats, 480x270, one thread, CPU ms (median, same run)")
    for name in ("pass", "reference", "cpu kernels", "ratio"):
        table.add_column(name, justify="right")
    results["reference"] = {}
    for name, make in (("forward", forward_function), ("forward and backward", both_function)):
        _, slow = time_it(make(splats, camera, "reference"), max(1, repeat // 10))
        _, fast = time_it(make(splats, camera, "cpu"), repeat)
        table.add_row(name, f"{slow:.0f}", f"{fast:.2f}", f"{slow / fast:.0f}")
        results["reference"][name] = {"reference_ms": slow, "cpu_ms": fast}
    console.print(table)


def peak_mib() -> float:
    """Peak memory of this process so far in MiB."""
    status = Path("/proc/self/status")
    if status.exists():  # getrusage would include the process that started this one
        return int(status.read_text().split("VmHWM:")[1].split()[0]) / 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def memory_of_this_process() -> None:
    """Print the peak resident memory in MiB before and after a forward and backward pass, 100k splats at 1280x720."""
    torch.set_num_threads(2)
    splats, camera = person(100_000, 1280, 720)
    forward_function(*person(10, 64, 64))()  # load the kernels
    before = peak_mib()
    run = both_function(splats, camera)
    for _ in range(3):
        run()
    print(json.dumps([before, peak_mib()]))


def memory_table(results: JsonObject) -> None:
    command = [sys.executable, __file__, "--memory-of-this-process"]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    out = subprocess.run(command, check=True, capture_output=True, text=True, env=environment).stdout
    before, after = json.loads(out)
    console.print(
        f"Memory, 100k splats at 1280x720, forward and backward: peak {after:.0f} MiB of the whole process, of which "
        f"{before:.0f} MiB before the first pass (Python, torch, the splats). Goal reached: {mark(after, 1536)}"
    )
    results["memory_mib"] = {"before": before, "peak": after}


def gpu_tables(repeat: int, results: JsonObject) -> None:
    """100k splats at 1920x1080: keyframe iterations per second, and seconds for a frame after the keyframe."""
    from studio.training import TrainingView, TrainSettings, train_interframe

    iteration_table(repeat, results, "cuda", 100_000, 1920, 1080)
    splats, camera = person(100_000, 1920, 1080, "cuda")
    moved = splats.clone()
    moved.means[:, 0] += 0.01 * torch.sin(4 * moved.means[:, 1])
    with torch.no_grad():
        render = rasterize(moved, camera)
    view = TrainingView(camera, render.image.clamp(0, 1), render.alpha, (camera.width, camera.height))
    settings = TrainSettings()
    torch.cuda.synchronize()
    start = time.perf_counter()
    train_interframe(splats, [view], settings, seed=0)
    torch.cuda.synchronize()
    seconds = time.perf_counter() - start
    console.print(
        f"Inter-frame training with default settings ({settings.motion_iterations} iterations of motion, "
        f"{settings.finetune_iterations} of fine-tuning): {seconds:.1f} s per frame"
    )
    results["interframe_seconds"] = seconds


def processor() -> str:
    if Path("/proc/cpuinfo").exists():
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    return platform.processor() or platform.machine()


def main() -> None:
    """Run all benchmarks and print their tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="5 repetitions instead of 31")
    parser.add_argument("--json", type=Path, help="also write the results to this file")
    parser.add_argument("--memory-of-this-process", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.memory_of_this_process:
        memory_of_this_process()
        return
    repeat = 5 if options.quick else 31
    kernels = load_kernels()
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else float("nan")
    console.print(
        f"{processor()}, {os.cpu_count()} cores, load {load:.1f}; torch {torch.__version__}; instruction set "
        f"{kernels.instruction_set()} of {', '.join(kernels.instruction_sets())}; backends "
        f"{', '.join(available_backends())}"
    )
    if load > 0.5:
        console.print("[yellow]Other programs are running: wall-clock times and two-thread speedups are affected.[/]")
    results: JsonObject = {"processor": processor(), "load": load, "instruction_set": kernels.instruction_set()}
    speed_table(repeat, results)
    goals_table(repeat, results)
    iteration_table(repeat, results, "cpu", 30_000, 480, 270)
    limits_table(repeat, results)
    reference_table(repeat, results)
    memory_table(results)
    if preferred_device().type == "cuda":
        gpu_tables(repeat, results)
    else:
        console.print("CUDA was not measured: there is no GPU, or neither gsplat nor Triton is installed.")
    if options.json is not None:
        options.json.write_text(json.dumps(results, indent=2))


if __name__ == "__main__":
    main()
