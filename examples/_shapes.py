"""Small scenes for the examples."""

import math

import numpy as np
import torch

import v3studio as v3


def swinging_cloud(count: int, time: float) -> v3.Gaussians:
    """`count` splats on a sphere that swings back and forth; one period is `time` 0 to 1. The order is fixed."""
    random = torch.Generator().manual_seed(0)
    directions = torch.nn.functional.normalize(torch.randn(count, 3, generator=random), dim=1)
    shift = torch.tensor([0.3 * math.sin(2 * math.pi * time), 0.0, 0.0])
    return v3.Gaussians.from_activated(
        means=0.5 * directions + shift,
        quats=torch.nn.functional.normalize(torch.randn(count, 4, generator=random), dim=1),
        scales=torch.full((count, 3), 0.03),
        opacities=torch.full((count,), 0.8),
        sh=(directions[:, None] * 0.5 + 0.5 - 0.5) / 0.28209479,
    )


def camera_of(manifest: "v3.Manifest | None" = None, width: int = 480, height: int = 360) -> v3.Camera:
    """A camera that sees the whole stream from its front (-y), OpenCV axes."""
    low, high = np.full(3, -1.0), np.full(3, 1.0)
    if manifest is not None:
        low, high = np.array(manifest.bounding_box.min), np.array(manifest.bounding_box.max)
    center, radius = (low + high) / 2, float(np.linalg.norm(high - low)) / 2
    pose = np.eye(4)
    pose[:3, :3] = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]  # x right; world z is up in the image
    pose[:3, 3] = -pose[:3, :3] @ (center - [0, 2.5 * radius, 0])
    focal = 0.9 * height
    return v3.Camera(
        name="front",
        width=width,
        height=height,
        K=np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1]]),
        world_to_camera=pose,
    )
