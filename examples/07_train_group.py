"""Train a group from arrays: images, masks and cameras in memory, without a take or files.

The images are rendered from known splats that move, so that the PSNR of a held-out camera can be computed.
"""

import argparse

import torch
from _shapes import swinging_cloud

import v3studio as v3

SIZE = 96
FRAMES = 3


def filmed(truth: v3.Gaussians, camera: v3.Camera, frame: int) -> v3.FootageView:
    """What a camera sees of the splats."""
    with torch.no_grad():
        drawn = v3.rasterize(truth, camera)
    image = (drawn.image.clamp(0, 1) * 255).round().to(torch.uint8).numpy()
    mask = (drawn.alpha * 255).round().to(torch.uint8).numpy()
    return v3.FootageView(camera=camera, image=image, mask=mask, frame=frame)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--iterations", type=int, default=150)
    iterations = parser.parse_args().iterations
    rig = v3.orbit((0, 0, 0), 2.5, 10, width=SIZE, height=SIZE, up=(0, 0, 1), field_of_view=53)
    print(rig)
    held_out, *cameras = rig
    settings = v3.TrainSettings(
        keyframe_iterations=iterations, densify_from=iterations, densify_until=iterations,
        prune_finetune_iterations=30, motion_iterations=40, finetune_iterations=60,
    )  # fmt: skip

    trained: list[v3.Gaussians] = []
    for frame in range(FRAMES):
        truth = swinging_cloud(1500, 0.02 * frame)
        views = [v3.TrainingView.from_view(filmed(truth, camera, frame)) for camera in cameras]
        if not trained:
            start = truth.means[::3]
            start = start + 0.02 * torch.randn(start.shape, generator=torch.Generator().manual_seed(1))
            trained.append(v3.train_keyframe(views, start, torch.full_like(start, 0.5), settings, seed=0))
        else:
            before = trained[-2] if frame > 1 else None
            result: v3.InterframeResult = v3.train_interframe(trained[-1], views, settings, before_previous=before)
            trained.append(result.gaussians)
        with torch.no_grad():
            image = v3.rasterize(trained[-1], held_out).image
            psnr = float(v3.psnr(image, v3.rasterize(truth, held_out).image))
        print(f"frame {frame}: {len(trained[-1])} splats, {psnr:.1f} dB in {held_out.name}, which was not trained on")
        assert psnr > 18


if __name__ == "__main__":
    main()
