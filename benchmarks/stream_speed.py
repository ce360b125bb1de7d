"""Speed of the stream at up to 300,000 splats: baking, opening, decoding, dequantizing.

    python benchmarks/stream_speed.py TAKE

The splats are those of the first group of a trained take, duplicated. Times are total CPU times of all threads, which
other programs hardly affect; the frames per second, last, are in wall time, from the file to arrays.
"""

import argparse
import os
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

os.environ.setdefault("OMP_WAIT_POLICY", "passive")

import numpy as np
import torch
from rich.console import Console

from v3studio.pipelines.reports.terminal import table_of
from v3studio.pipelines.takes.frames.frame_files import read_frame
from v3studio.pipelines.takes.take import Take
from v3studio.studio.errors import StudioError
from v3studio.studio.gaussians import Gaussians
from v3studio.studio.playback import play_headless
from v3studio.studio.stream import BakeSettings, StreamReader, bake_group, write_manifest

SPLATS = (60_000, 100_000, 300_000)


def trained_group(take: Path, index: int, splats: int) -> list[Gaussians]:
    """The trained frames of a group, enlarged to a number of splats; none if there is no such group."""
    files = sorted(Take.open(take).train_group(index).glob("frame_*.safetensors"))
    return enlarged([read_frame(file) for file in files], splats) if files else []


def enlarged(frames: list[Gaussians], count: int) -> list[Gaussians]:
    """Frames with `count` splats: those of the take, repeated with small offsets and the same motion."""
    generator = torch.Generator().manual_seed(0)
    index = torch.arange(count) % len(frames[0])
    shift = torch.zeros(count, 3)
    copies = count - len(frames[0])
    if copies > 0:
        shift[-copies:] = torch.randn(copies, 3, generator=generator) * float(frames[0].scales.median())
    result = []
    for frame in frames:
        part = frame[index]
        result.append(Gaussians(part.means + shift, part.quats, part.log_scales, part.logit_opacities, part.sh))
    return result


def measure(take: Path, work: Path) -> None:
    """Print the times of two groups, from the first frame to the last."""
    columns = ("KB per frame", "bake, ms per frame", "open, ms per group", "decode, ms per frame", "dequantize, ms")
    table = table_of("splats", *columns, "frames per second")
    for count in SPLATS:
        frames = trained_group(take, 0, count)
        if not frames:
            raise StudioError("benchmark.not_trained", "the take has no trained frames", file=take)
        folder = work / str(count)
        settings = BakeSettings()
        began = time.process_time()
        entry = bake_group(frames, folder, 0, 0, settings)
        bake = 1e3 * (time.process_time() - began) / len(frames)
        again = bake_group(frames, folder, 1, len(frames), settings)
        write_manifest(folder, [entry, again], 30, settings)
        opens, decodes, dequantizes, plays = [], [], [], []
        with StreamReader.open(folder) as reader:
            for _ in range(3):
                files = reader.fetch(reader.groups[0])
                began = time.process_time()
                decoder = reader.open_group(reader.groups[0], files)
                opens.append(1e3 * (time.process_time() - began))
                began = time.process_time()
                decoded = [decoder.read() for _ in frames]
                decodes.append(1e3 * (time.process_time() - began) / len(frames))
                for frame in decoded:
                    began = time.thread_time()
                    frame.gaussians()
                    dequantizes.append(1e3 * (time.thread_time() - began))
                decoder.close()
        for _ in range(3):
            times: list[float] = []
            play_headless(folder, on_frame=lambda _: times.append(time.perf_counter()))  # noqa: B023
            plays.append((len(times) - 1) / (times[-1] - times[0]))
        size = sum(file.bytes for file in entry.files)
        figures = size / len(frames) / 1000, bake, min(opens)
        texts = [f"{figure:.0f}" for figure in figures] + [f"{min(decodes):.1f}", f"{np.median(dequantizes):.1f}"]
        table.add_row(f"{count:,}", *texts, f"{max(plays):.0f}")
    Console(width=112).print(table)


def main(words: Sequence[str] | None = None) -> None:
    """Measure a take and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("take", type=Path, help="folder of a trained take")
    with tempfile.TemporaryDirectory() as folder:
        measure(parser.parse_args(words).take, Path(folder))


if __name__ == "__main__":
    main()
