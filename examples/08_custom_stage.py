"""Add your own step between training and baking: remove faint splats, then bake the take again.

    python examples/08_custom_stage.py demo-take --out stream-without-faint-splats

The take itself is not modified. Without a take, it uses a small synthetic cloud. A splat must be kept or removed in all
frames of its group, because the stream encodes the same splats in each of them.
"""

import argparse
import tempfile
from pathlib import Path

import torch
from _shapes import swinging_cloud

import v3studio as v3


def without_faint(video: v3.SplatVideo, least: float) -> v3.SplatVideo:
    """The video without splats whose opacity is below `least` (0 to 1) in all frames of their group."""
    kept = {}
    for group in video.groups:
        highest = torch.stack([video.read(index).opacities for index in group]).max(dim=0).values
        for index in group:
            kept[index] = highest >= least
    return v3.SplatVideo(
        video.name,
        video.fps,
        video.frame_count,
        video.group_starts,
        lambda index: video.read(index)[kept[index]],
        up=video.up,
        view=video.view,
        background=video.background,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("take", nargs="?", type=Path)
    parser.add_argument("--least-opacity", type=float, default=0.05)
    parser.add_argument("--out", type=Path, help="folder of the new stream (default: a temporary folder)")
    arguments = parser.parse_args()
    if arguments.take:
        video = v3.trained_video(arguments.take)
    else:
        cloud = swinging_cloud(2000, 0.0)
        cloud = v3.Gaussians.from_activated(
            cloud.means, cloud.quats, cloud.scales, torch.linspace(0, 0.9, 2000), cloud.sh
        )
        video = v3.SplatVideo("cloud", fps=25, frame_count=4, group_starts=(0,), read=lambda index: cloud)
    thinned = without_faint(video, arguments.least_opacity)
    print(f"frame 0: {len(video.read(0))} splats, {len(thinned.read(0))} of them kept")
    assert len(thinned.read(0)) <= len(video.read(0))
    manifest = v3.bake_video(thinned, arguments.out or Path(tempfile.mkdtemp()) / "stream", v3.BakeSettings())
    print(f"{manifest.total_bytes:,} bytes")


if __name__ == "__main__":
    main()
