"""OpenSplat's CPU rasterizer, compiled from a checkout of it, to be timed beside ours in one run.

OpenSplat (AGPL) is not part of this repository: `benchmarks/rasterizer.py --opensplat DIR` compiles
`DIR/rasterizer/gsplat-cpu/gsplat_cpu.cpp` with PyTorch's own tool into DIR/build-v3studio, optimized for this machine.
As in OpenSplat's training, projection and harmonics are differentiated by PyTorch, the rasterizer by its own code.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch

from studio.cameras import Camera
from studio.gaussians import Gaussians

SOURCE = Path("rasterizer/gsplat-cpu/gsplat_cpu.cpp")
_NEAR, _FAR = 0.01, 100.0


def load_opensplat(checkout: Path) -> Any:
    """The compiled module.

    Raises:
        SystemExit: if the folder is no checkout of OpenSplat, or it cannot be compiled.
    """
    source = checkout / SOURCE
    if not source.is_file():
        raise SystemExit(f"{source} is missing: give the folder of a checkout of OpenSplat to --opensplat.")
    from torch.utils.cpp_extension import load

    build = checkout / "build-v3studio"
    build.mkdir(exist_ok=True)
    os.environ["PATH"] = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])  # ninja
    try:
        return load(
            name="opensplat_cpu",
            sources=[str(source), str(Path(__file__).with_name("opensplat_binding.cpp"))],
            extra_include_paths=[str(source.parent)],
            extra_cflags=["-O3", "-march=native", "-std=c++20"],
            build_directory=str(build),
        )
    except RuntimeError as error:
        raise SystemExit(f"{source} cannot be compiled: {error}") from None


def draw(peer: Any, splats: Gaussians, camera: Camera) -> torch.Tensor:
    """(H, W, 3) image over black, with gradients for all attributes of the splats."""
    view, projection = _matrices(camera)
    centers, _, conics, covariances, depths = peer.project(
        splats.means, splats.scales, splats.quats, view, projection,
        float(camera.K[0, 0]), float(camera.K[1, 1]), float(camera.K[0, 2]), float(camera.K[1, 2]),
        camera.height, camera.width, _NEAR,
    )  # fmt: skip
    directions = splats.means.detach() - torch.from_numpy(camera.center).to(splats.means)
    directions = torch.nn.functional.normalize(directions, dim=-1)
    colors = torch.clamp_min(peer.harmonics(splats.sh_degree, directions, splats.sh) + 0.5, 0.0)
    arguments = (peer, camera.width, camera.height, covariances.detach().contiguous(), depths.detach().contiguous())
    image: torch.Tensor = _Rasterize.apply(*arguments, centers, conics, colors, splats.opacities[:, None])
    return image


def both_function(peer: Any, splats: Gaussians, camera: Camera) -> Callable[[], None]:
    """Draws once and computes the gradients of all attributes."""
    trained = splats.map(lambda tensor: tensor.detach().clone().requires_grad_())
    upstream = torch.randn(camera.height, camera.width, 3)

    def run() -> None:
        torch.autograd.backward(draw(peer, trained, camera), upstream)
        for _, tensor in trained.items():
            tensor.grad = None

    return run


class _Rasterize(torch.autograd.Function):
    @staticmethod
    def forward(  # type: ignore[override]
        ctx: Any,
        peer: Any,
        width: int,
        height: int,
        covariances: torch.Tensor,
        depths: torch.Tensor,
        *splats: torch.Tensor,  # centers, conics, colors, opacities
    ) -> torch.Tensor:
        arguments = (*(one.detach().contiguous() for one in splats), torch.zeros(3), covariances, depths)
        image, transmittance, lists = peer.forward(width, height, *arguments)
        ctx.known = (peer, width, height, arguments, transmittance, lists)
        return image

    @staticmethod
    def backward(ctx: Any, upstream: torch.Tensor) -> tuple[Any, ...]:  # type: ignore[override]
        peer, width, height, arguments, transmittance, lists = ctx.known
        no_alpha = torch.zeros(height, width)
        found = peer.backward(height, width, *arguments, transmittance, lists, upstream.contiguous(), no_alpha)
        peer.release(lists)
        return (None,) * 5 + tuple(found)


def _matrices(camera: Camera) -> tuple[torch.Tensor, torch.Tensor]:
    """World to camera, and world to normalized device coordinates; (4, 4) float32."""
    view = torch.from_numpy(camera.world_to_camera).float()
    fx, fy, cx, cy = (float(camera.K[row, column]) for row, column in ((0, 0), (1, 1), (0, 2), (1, 2)))
    projection = torch.zeros(4, 4)
    projection[0, 0], projection[0, 2] = 2 * fx / camera.width, 2 * cx / camera.width - 1
    projection[1, 1], projection[1, 2] = 2 * fy / camera.height, 2 * cy / camera.height - 1
    projection[2, 2], projection[2, 3] = (_FAR + _NEAR) / (_FAR - _NEAR), -2 * _FAR * _NEAR / (_FAR - _NEAR)
    projection[3, 2] = 1.0
    return view, projection @ view
