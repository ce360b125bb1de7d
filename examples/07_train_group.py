"""Makes a stream from footage without a take: open, initialize, train a group, measure it, bake it.

Images need not come from files: `v3.FootageView(camera=..., image=..., mask=..., frame=...)` holds arrays, and can be
used in place of `footage.view(...)`.
"""

import argparse
import tempfile
from pathlib import Path

import torch

import v3studio as v3

SAMPLE = Path(__file__).resolve().parents[1] / "sample_captures" / "dance16"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--iterations", type=int, default=80)
    parser.add_argument("--out", help="folder of the stream (default: a temporary folder)")
    arguments = parser.parse_args()
    rig = v3.read_rig(SAMPLE)
    capture = v3.CaptureSettings(
        root=SAMPLE, masks="clean_plate", cameras=tuple(rig.names[1::2]), held_out=("cam05",), frames=":3", scale=0.25
    )
    footage = v3.open_footage(capture, rig)
    print(footage.description)
    settings = v3.TrainSettings(
        keyframe_iterations=arguments.iterations, densify_from=20, densify_until=arguments.iterations,
        prune_finetune_iterations=20, motion_iterations=20, finetune_iterations=30,
    )  # fmt: skip

    trained: list[v3.Gaussians] = []
    for frame in footage.frames:
        filmed = [footage.view(camera, frame) for camera in footage.train_cameras]
        views = [v3.TrainingView.from_view(view, crop_margin=settings.crop_margin) for view in filmed]
        if not trained:
            start = v3.initialize_points(filmed, v3.InitializeSettings(points=2000, resolution=64))
            points, colors = torch.from_numpy(start.points), torch.from_numpy(start.colors)
            trained.append(v3.train_keyframe(views, points, colors, settings, seed=0))
        else:
            before = trained[-2] if len(trained) > 1 else None
            trained.append(v3.train_interframe(trained[-1], views, settings, before_previous=before))
        for camera, figures in v3.evaluate(trained[-1], footage, frame).items():
            print(f"frame {frame}: {len(trained[-1])} splats, {figures['psnr']:.1f} dB in {camera}, not trained on")
            assert figures["psnr"] > 18

    video = v3.SplatVideo(
        "walk", footage.fps, len(trained), group_starts=(0,), read=trained.__getitem__, up=rig.up, view=rig["cam05"]
    )
    stream = arguments.out or Path(tempfile.mkdtemp()) / "stream"
    manifest = v3.bake_video(video, stream, v3.BakeSettings())
    print(f"{stream}: {manifest.total_bytes:,} bytes")
    assert manifest.frame_count == len(footage.frames)
    assert manifest.metadata["up"][2] > 0.99, "the sample is z up"


if __name__ == "__main__":
    main()
