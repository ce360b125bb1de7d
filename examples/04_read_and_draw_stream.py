"""Read a stream and render its frames.

    python examples/04_read_and_draw_stream.py demo-take/stream --out frames/
    python examples/04_read_and_draw_stream.py http://192.168.1.10:8000/ --out frames/

Without an argument, it bakes a small stream first.
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np
import torch
from _shapes import camera_of, swinging_cloud
from PIL import Image

import v3studio as v3


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("stream", nargs="?", help="folder or http(s) URL")
    parser.add_argument("--out", type=Path, help="folder for the images (default: a temporary folder)")
    arguments = parser.parse_args()
    out = arguments.out or Path(tempfile.mkdtemp())
    out.mkdir(parents=True, exist_ok=True)
    stream = arguments.stream or make_stream(out / "stream")

    with v3.StreamReader.open(stream) as reader:
        camera = camera_of(reader.manifest)
        for index, gaussians in enumerate(reader.iterate(stop=5)):
            with torch.no_grad():
                drawn = v3.rasterize(gaussians, camera, background=torch.tensor([0.1, 0.1, 0.1]))
            picture = (drawn.image.clamp(0, 1) * 255).round().to(torch.uint8).numpy()
            Image.fromarray(picture).save(out / f"{index:06d}.png")
            covered = np.mean(drawn.alpha.numpy() > 0.5)
            print(f"frame {index}: {len(gaussians)} splats cover {covered:.0%} of the image")
            assert drawn.alpha.max() > 0.5
    print(f"images: {out}")


def make_stream(folder: Path) -> Path:
    frames = [swinging_cloud(2000, time / 8) for time in range(8)]
    video = v3.SplatVideo("cloud", fps=25, frame_count=len(frames), group_starts=(0,), read=frames.__getitem__)
    v3.bake_video(video, folder, v3.BakeSettings())
    return folder


if __name__ == "__main__":
    main()
