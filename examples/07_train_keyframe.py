"""Train one keyframe from arrays: images, masks and cameras in memory, without a take or files.

The images are rendered from known splats, so that the PSNR of a held-out camera can be computed.
"""

import argparse
from types import SimpleNamespace

import numpy as np
import torch
from _shapes import swinging_cloud

import v3studio as v3

SIZE = 96


def ring_camera(index: int, count: int) -> v3.Camera:
    """Camera `index` of `count` on a circle around the z axis, 2.5 away, OpenCV axes."""
    angle = 2 * np.pi * index / count
    eye = 2.5 * np.array([np.cos(angle), np.sin(angle), 0.2])
    forward = -eye / np.linalg.norm(eye)
    right = np.cross(forward, [0, 0, 1.0])
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = [right, np.cross(forward, right), forward]
    pose[:3, 3] = -pose[:3, :3] @ eye
    K = np.array([[SIZE, 0, SIZE / 2], [0, SIZE, SIZE / 2], [0, 0, 1.0]])
    return v3.Camera(name=f"cam{index:02d}", width=SIZE, height=SIZE, K=K, world_to_camera=pose)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--iterations", type=int, default=150)
    iterations = parser.parse_args().iterations
    truth = swinging_cloud(1500, 0.0)
    views, held_out = [], None
    for index in range(10):
        camera = ring_camera(index, 10)
        with torch.no_grad():
            drawn = v3.rasterize(truth, camera)
        if index == 5:
            held_out = (camera, drawn.image)
            continue
        image = (drawn.image.clamp(0, 1) * 255).round().to(torch.uint8).numpy()
        mask = (drawn.alpha * 255).round().to(torch.uint8).numpy()
        captured = SimpleNamespace(camera=camera, image=image, mask=mask, plate=None)
        views.append(v3.TrainingView.from_view(captured))

    settings = v3.TrainSettings(
        keyframe_iterations=iterations, densify_from=iterations, densify_until=iterations, prune_finetune_iterations=30
    )
    start = truth.means[::3] + 0.02 * torch.randn(len(truth.means[::3]), 3, generator=torch.Generator().manual_seed(1))
    gaussians = v3.train_keyframe(views, start, torch.full_like(start, 0.5), settings, seed=0)

    assert held_out is not None
    with torch.no_grad():
        psnr = float(v3.psnr(v3.rasterize(gaussians, held_out[0]).image, held_out[1]))
    print(f"{len(gaussians)} splats after {iterations} iterations; held-out camera {held_out[0].name}: {psnr:.1f} dB")
    assert psnr > 18


if __name__ == "__main__":
    main()
