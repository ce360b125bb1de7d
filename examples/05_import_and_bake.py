"""Bake a sequence of PLY files (from any 3D Gaussian Splatting program) into a stream.

    python examples/05_import_and_bake.py plys/ --out stream

Without an argument, it writes a few PLY files first.
"""

import argparse
import tempfile
from pathlib import Path

from _shapes import swinging_cloud

import v3studio as v3


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("plys", nargs="?", type=Path, help="folder of .ply files, one per frame")
    parser.add_argument("--out", type=Path, help="folder of the stream (default: a temporary folder)")
    parser.add_argument("--fps", type=float, default=30)
    parser.add_argument("--qp", type=int, default=22)
    arguments = parser.parse_args()
    scratch = Path(tempfile.mkdtemp())
    plys = arguments.plys
    if plys is None:
        plys = scratch / "plys"
        plys.mkdir()
        for frame in range(6):
            v3.write_splats(swinging_cloud(1500, frame / 100), plys / f"{frame:06d}.ply")

    video = v3.open_import(plys, arguments.fps)
    print(f"{plys}: {video.frame_count} frames; groups start at frames {video.group_starts}")
    manifest = v3.bake_video(video, arguments.out or scratch / "stream", v3.BakeSettings(quality=arguments.qp))
    print(f"{manifest.total_bytes:,} bytes, {manifest.total_bytes / manifest.frame_count / 1000:.1f} KB per frame")
    assert manifest.frame_count == video.frame_count


if __name__ == "__main__":
    main()
