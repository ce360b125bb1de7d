"""The scene on which passes of the rasterizer are timed, and the clock.

The scene is a person-like surface: an ellipsoid of 0.6 x 1.7 x 0.4 m, seen so that 2 m fill 90% of the image height.
Its splats have a radius of 2 to 4 pixels (at which alpha falls to 1/255) and SH degree 3.
"""

import math
import statistics
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import torch

from v3studio.studio.cameras import Camera
from v3studio.studio.gaussians import Gaussians
from v3studio.studio.rasterizer import rasterize


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
