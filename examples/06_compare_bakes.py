"""Compare bakes of the same splats: bytes per frame, and PSNR of rendered frames against the splats before baking."""

import argparse
import tempfile
from pathlib import Path

import torch
from _shapes import camera_of, swinging_cloud

import v3studio as v3


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--qps", type=int, nargs="+", default=[14, 28])
    arguments = parser.parse_args()
    frames = [swinging_cloud(3000, time / 8) for time in range(8)]
    video = v3.SplatVideo("cloud", fps=25, frame_count=len(frames), group_starts=(0,), read=frames.__getitem__)
    camera = camera_of()
    folder = Path(tempfile.mkdtemp())
    measured = []
    for qp in arguments.qps:
        manifest = v3.bake_video(video, folder / f"qp{qp}", v3.BakeSettings(quality=qp))
        with v3.StreamReader.open(folder / f"qp{qp}") as reader, torch.no_grad():
            psnrs = [
                float(v3.psnr(v3.rasterize(decoded, camera).image, v3.rasterize(frame, camera).image))
                for decoded, frame in zip(reader.iterate(), frames, strict=True)
            ]
        measured.append((manifest.total_bytes, sum(psnrs) / len(psnrs)))
        print(
            f"QP {qp}: {manifest.total_bytes / len(frames) / 1000:.1f} KB per frame, {measured[-1][1]:.2f} dB, "
            f"worst {min(psnrs):.2f} dB"
        )
    if arguments.qps == sorted(set(arguments.qps)):
        assert measured == sorted(measured, reverse=True), "a higher QP must give fewer bytes and a lower PSNR"


if __name__ == "__main__":
    main()
