"""The renditions of a baked take: bytes, quality and decoding time of each, as a table in Markdown.

    python benchmarks/ladder.py TAKE [--write docs/measurements/stream.md] [--title sample]

TAKE has been baked with `v3studio bake TAKE --ladder`. Quality as in `rate_distortion.py`: from the held-out cameras in
the bounding box of the performer. Times are CPU time of one thread per frame: to open a group and decode its video, and
to dequantize frames to arrays; median over groups and three runs.
"""

from __future__ import annotations

import argparse
import os
import time
from pathlib import Path

os.environ.setdefault("OMP_WAIT_POLICY", "passive")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import torch
from rate_distortion import console, load_take, write_between

from studio.stream import StreamReader, fetch_group

RUNS = 3


def processor() -> str:
    """Model name of the CPU, as Linux tells it."""
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    return next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), "unknown CPU")


def times(folder: Path, rendition: str) -> tuple[float, float]:
    """CPU time in ms to decode and to dequantize a frame, on one thread: mean over a group, median over groups and
    runs. (Frames of one group cannot be compared, since a decoder reads ahead where there are B-frames.)"""
    found = []
    with StreamReader.open(folder, threads=1, rendition=rendition) as reader:
        for _ in range(RUNS):
            for group in reader.manifest.groups:
                files = fetch_group(reader.source, group)
                began = time.process_time()
                decoder = reader.open_group(group, files)
                frames = [decoder.read() for _ in range(group.frame_count)]
                decoded = time.process_time()
                for frame in frames:
                    frame.gaussians()
                done = time.process_time()
                decoder.close()
                found.append([1e3 * (decoded - began) / group.frame_count, 1e3 * (done - decoded) / group.frame_count])
    decode, dequantize = np.median(found, axis=0)
    return float(decode), float(dequantize)


def main() -> None:
    parser = argparse.ArgumentParser(description="Table of the renditions of a baked take.")
    parser.add_argument("take", type=Path)
    parser.add_argument("--write", type=Path, metavar="FILE", help="write the table between its markers in this file")
    parser.add_argument("--title", default="")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    views, groups = load_take(arguments.take, None)
    stream = arguments.take / "stream"
    indices = [index for group in groups for index in group.indices]
    with StreamReader.open(stream) as reader:
        renditions = reader.renditions
    title = f"{arguments.title}: " if arguments.title else ""
    lines = [
        f"{title}{len(groups)} groups, {len(indices)} frames; {'held-out' if views.held_out else 'training'} cameras "
        f"{', '.join(views.cameras)}, where the trained splats have {views.trained_psnr():.2f} dB to the footage. "
        f"{processor()}, one thread, load {os.getloadavg()[0]:.1f} while measuring.",
        "",
        "| rendition | splats | fine-tuned | KB per frame | PSNR to footage | worst frame | PSNR to trained | decode |"
        " dequantize |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for one in renditions:
        with StreamReader.open(stream, threads=1, rendition=one.id) as reader:
            drawn = dict(zip(indices, reader.iterate(), strict=True))
        footage, trained, worst = views.measure_all(drawn)
        decode, dequantize = times(stream, one.id)
        tuned = {"none": "", "importance": "no", "fine-tuned": "yes"}[one.pruning]
        lines.append(
            f"| {one.id} | {one.splats:,} | {tuned} | {one.bytes / len(indices) / 1000:.1f} | {footage:.2f} dB | "
            f"{worst:.2f} dB | {trained:.2f} dB | {decode:.1f} ms | {dequantize:.1f} ms |"
        )
        console.print(lines[-1], markup=False, highlight=False, soft_wrap=True)
    console.print("\n".join(lines), markup=False, highlight=False, soft_wrap=True)
    if arguments.write:
        write_between(arguments.write, "ladder", "\n".join(lines))


if __name__ == "__main__":
    main()
