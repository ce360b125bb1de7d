"""Speed of the rasterizer, alone and compared with the reference.

    python benchmarks/rasterizer.py [--repeat 31]    # about two minutes on two cores

Times are medians over repetitions and wall-clock times unless labeled as CPU time. Ratios compare times of the same
run. `benchmarks/training.py` measures training, and `benchmarks/gpu_check.py` GPUs.

The scene is a person-like surface: an ellipsoid of 0.6 x 1.7 x 0.4 m, seen so that 2 m fill 90% of the image height.
Its splats have a radius of 2 to 4 pixels (at which alpha falls to 1/255) and SH degree 3.
"""

import argparse
import math
import os
import statistics
import time
from collections.abc import Callable
from typing import Any

os.environ.setdefault("OMP_WAIT_POLICY", "passive")  # see studio.process; read when torch is imported

import numpy as np
import torch
from rich.console import Console

from v3studio.pipelines.reports.terminal import table_of
from v3studio.studio.cameras import Camera
from v3studio.studio.gaussians import Gaussians
from v3studio.studio.rasterizer import available_backends, rasterize
from v3studio.studio.rasterizer.cpu import load_kernels

console = Console(width=112)


def person(count: int, width: int, height: int, device: str = "cpu") -> tuple[Gaussians, Camera]:
    """Splats on an ellipsoid, and a camera that sees all of it."""
    generator = torch.Generator().manual_seed(0)

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


def speed_table(repeat: int) -> None:
    table = table_of("image", "splats", "threads", "forward", "fwd + bwd", "CPU, 1 thread", "2 threads")
    table.title = "CPU kernels, person-like surface, milliseconds (median)"
    for width, height in ((480, 270), (960, 540)):
        for count in (5_000, 30_000, 100_000):
            scene = person(count, width, height)
            single = 0.0
            for threads in (1, 2):
                torch.set_num_threads(threads)
                forward, _ = time_it(forward_function(*scene), repeat)
                both, cpu = time_it(both_function(*scene), repeat)
                last = (f"{cpu:.1f}", "") if threads == 1 else ("", f"x{single / both:.2f}")
                single = both
                table.add_row(f"{width}x{height}", f"{count}", f"{threads}", f"{forward:.1f}", f"{both:.1f}", *last)
    console.print(table)


def reference_table(repeat: int) -> None:
    torch.set_num_threads(1)
    scene = person(5_000, 480, 270)
    table = table_of("pass", "reference", "cpu kernels", "ratio")
    table.title = "Compared with the torch reference: 5k splats, 480x270, one thread, CPU ms (median, same run)"
    for name, make in (("forward", forward_function), ("forward and backward", both_function)):
        _, slow = time_it(make(*scene, "reference"), max(1, repeat // 10))
        _, fast = time_it(make(*scene, "cpu"), repeat)
        table.add_row(name, f"{slow:.0f}", f"{fast:.2f}", f"{slow / fast:.0f}")
    console.print(table)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeat", type=int, default=31, help="repetitions")
    repeat = parser.parse_args().repeat
    kernels, load = load_kernels(), os.getloadavg()[0]
    console.print(
        f"{os.cpu_count()} cores, load {load:.1f}; torch {torch.__version__}; instruction set "
        f"{kernels.instruction_set()} of {', '.join(kernels.instruction_sets())}; backends "
        f"{', '.join(available_backends())}"
    )
    if load > 0.5:
        console.print("[yellow]Other programs are running: wall-clock times and two-thread speedups are affected.[/]")
    speed_table(repeat)
    reference_table(repeat)


if __name__ == "__main__":
    main()
