"""Rate and distortion of a stream: our two profiles compared with the paper's released bake, on a trained take.

    python benchmarks/rate_distortion.py TAKE                          # all groups, several minutes on two cores
    python benchmarks/rate_distortion.py TAKE --groups 0,2             # some groups
    python benchmarks/rate_distortion.py TAKE --speed                  # bake, open, decode at up to 300,000 splats

Frames are rendered from the take's held-out cameras (or from its training cameras if none is held out) and compared,
within the bounding box of the performer's mask, with the footage and with the trained splats before baking. PSNR is
computed from the mean squared error over all views. Bytes include all files of all groups, but not the manifest or the
JSON files of the released layout.

`released` is a reimplementation of the released code's behavior: no Morton order, ranges per frame, activated values,
truncation instead of rounding, one video per channel including three for normals, a QP of at most 22 for color, scale
and rotation, and lossless high bytes. It is tested with B frames (x264's default) and with I and P frames only; the one
with the better BD-rate is used.
"""

import argparse
import math
import os
import shutil
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

os.environ.setdefault("OMP_WAIT_POLICY", "passive")

import av
import bjontegaard
import numpy as np
import torch
from rich.console import Console

from v3studio.pipelines.ablation.study import METHOD, monotonic
from v3studio.pipelines.config import load_config
from v3studio.pipelines.stages.compared_view import ComparedView, compared_cameras, compared_view
from v3studio.pipelines.stages.inputs import Inputs
from v3studio.pipelines.takes.frames.frame_files import read_frame
from v3studio.pipelines.takes.take import Take
from v3studio.studio.atomic_files import write_json
from v3studio.studio.errors import StudioError
from v3studio.studio.formats.videogs import open_videogs
from v3studio.studio.gaussians import Gaussians
from v3studio.studio.playback import play_headless
from v3studio.studio.stream import BakeSettings, StreamReader, bake_group, write_manifest
from v3studio.studio.stream.layout import plane_side

Profile = Literal["motion", "planes"]
RELEASED_QPS = (10, 16, 22, 28, 34, 40)
OUR_QPS: dict[Profile, tuple[int, ...]] = {"planes": (10, 16, 22, 28, 34, 40), "motion": (12, 16, 20, 24, 28, 32)}
SPEED_SPLATS = (60_000, 100_000, 300_000)

console = Console(width=120)


@dataclass
class Point:
    """Rate, distortion and times of one bake."""

    name: str
    qp: int
    kilobytes: float  # per frame, units of 1000 bytes
    footage_psnr: float
    own_psnr: float
    encode_ms: float  # per frame
    decode_ms: float


class Views:
    """The views of the evaluation of some frames: footage, and renders of the trained splats."""

    def __init__(self, inputs: Inputs) -> None:
        self.inputs, self.cameras = inputs, compared_cameras(inputs.trained_footage)
        self.trained: list[tuple[int, ComparedView, np.ndarray, float]] = []
        """Index of the frame in the take, view, (h, w, 3) what it shows of the trained splats, and its error."""

    def add(self, index: int, gaussians: Gaussians) -> None:
        """Add frame `index` of the take."""
        for camera in self.cameras:
            view = compared_view(self.inputs, camera, self.inputs.trained_footage.frames[index])
            if view is not None:
                pair = view.pair(gaussians)
                self.trained.append((index, view, pair.rendered, _error(pair.rendered, pair.footage)))

    def measure(self, frames: dict[int, Gaussians]) -> tuple[float, float]:
        """PSNR in dB relative to the footage and to the trained splats, over all views of `frames`."""
        errors = []
        for index, view, trained, _ in self.trained:
            if index in frames:
                pair = view.pair(frames[index])
                errors.append((_error(pair.rendered, pair.footage), _error(pair.rendered, trained)))
        footage, own = np.mean(errors, axis=0)
        return _psnr(footage), _psnr(own)


def _error(image: np.ndarray, wanted: np.ndarray) -> float:
    return float(np.square(image - wanted).mean())


def _psnr(error: float | np.floating) -> float:
    return -10 * math.log10(max(error, 1e-12))


TakeGroup = dict[int, Gaussians]
"""Frames of one group by their index in the take."""


# ---- the released bake -----------------------------------------------------------------------------------------------


def released_channels(frames: Sequence[Gaussians]) -> list[np.ndarray]:
    """(A, N) per frame: activated values in PLY order, including normals."""
    result = []
    for frame in frames:
        quats = frame.unit_quats.numpy().T
        rest = frame.sh.numpy().reshape(len(frame), -1).T
        parts = [frame.means.numpy().T, np.zeros((3, len(frame)), np.float32), rest]
        parts += [frame.opacities.numpy()[None], frame.scales.numpy().T, quats]
        result.append(np.concatenate(parts).astype(np.float64))
    return result


def encode_released(planes: list[np.ndarray], path: Path, qp: int, b_frames: bool) -> None:
    with av.open(str(path), "w", format="mp4") as out:
        stream = out.add_stream("libx264", rate=30)
        stream.width = stream.height = planes[0].shape[0]
        stream.pix_fmt = "yuv420p"
        stream.codec_context.color_range = 2
        stream.codec_context.thread_count = 1
        stream.codec_context.options = {"qp": str(qp), **({} if b_frames else {"bf": "0"})}
        for number, plane in enumerate(planes):
            picture = av.VideoFrame(plane.shape[1], plane.shape[0], "yuv420p")
            for k, target in enumerate(picture.planes):
                view = np.frombuffer(memoryview(target), np.uint8).reshape(-1, target.line_size)
                view[:, : target.width] = plane if k == 0 else 128
            picture.pts = number
            out.mux(stream.encode(picture))
        out.mux(stream.encode())


def bake_released(
    frames: Sequence[Gaussians], folder: Path, qp: int, b_frames: bool, pool: ThreadPoolExecutor
) -> tuple[int, list[Gaussians], float, float]:
    """Bytes, decoded frames, and the times to bake and to decode in seconds."""
    began = time.perf_counter()
    values = released_channels(frames)
    count = len(frames[0])
    side, channels = plane_side(count), len(values[0])
    lows = [v.min(axis=1, keepdims=True) for v in values]
    highs = [v.max(axis=1, keepdims=True) for v in values]
    levels = np.where(np.arange(channels) < 3, 65535, 255)[:, None]
    # the released code divides by zero for a constant channel; if it does not crash, the result is 0
    codes = [
        np.floor((v - a) / np.where(b > a, b - a, 1) * levels).astype(np.int64)
        for v, a, b in zip(values, lows, highs, strict=True)
    ]
    jobs: list[tuple[list[np.ndarray], int]] = []
    opacity = channels - 8
    for c in range(channels):
        channel_qp = qp if c == opacity else min(qp, 22)
        parts = (("low", qp), ("high", 0)) if c < 3 else (("all", channel_qp),)
        for part, part_qp in parts:
            planes = []
            for frame in codes:
                plane = np.zeros(side * side, np.uint8)
                plane[:count] = frame[c] >> 8 if part == "high" else frame[c] & 255
                planes.append(plane.reshape(side, side))
            jobs.append((planes, part_qp))
    place = folder / "group0"
    place.mkdir(parents=True)
    list(pool.map(lambda n: encode_released(jobs[n][0], place / f"{n}.mp4", jobs[n][1], b_frames), range(len(jobs))))
    encoded = time.perf_counter()
    size = sum(path.stat().st_size for path in place.iterdir())
    ranges = [np.hstack([low, high]).ravel().tolist() for low, high in zip(lows, highs, strict=True)]
    write_json(folder / "group_info.json", {"0": {"frame_index": [0, len(frames) - 1]}})
    write_json(folder / "viewer_min_max.json", {str(f): {"num": count, "info": info} for f, info in enumerate(ranges)})
    video = open_videogs(folder)
    decoded = [video.read(f) for f in range(len(frames))]
    return size, decoded, encoded - began, time.perf_counter() - encoded


# ---- ours ------------------------------------------------------------------------------------------------------------


def measure_ours(groups: list[TakeGroup], views: Views, qp: int, profile: Profile, work: Path) -> Point:
    folder, settings = work / "ours", BakeSettings(profile=profile, quality=qp)
    shutil.rmtree(folder, ignore_errors=True)
    began = time.perf_counter()
    first, entries = 0, []
    for number, group in enumerate(groups):
        entries.append(bake_group(list(group.values()), folder, number, first, settings))
        first += len(group)
    baked = time.perf_counter()
    write_manifest(folder, entries, 30, settings)
    opened = time.perf_counter()
    with StreamReader.open(folder) as reader:
        decoded = list(reader.iterate())
    done = time.perf_counter()
    indices = [index for group in groups for index in group]
    footage, own = views.measure(dict(zip(indices, decoded, strict=True)))
    size = sum(file.bytes for entry in entries for file in entry.files)
    frames = len(indices)
    times = 1e3 * (baked - began) / frames, 1e3 * (done - opened) / frames
    return Point(profile, qp, size / frames / 1000, footage, own, *times)


def measure_released(groups: list[TakeGroup], views: Views, qp: int, b_frames: bool, work: Path) -> Point:
    size, encode, decode = 0, 0.0, 0.0
    decoded: dict[int, Gaussians] = {}
    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        for group in groups:
            folder = work / "released"
            shutil.rmtree(folder, ignore_errors=True)
            part, frames, encode_s, decode_s = bake_released(list(group.values()), folder, qp, b_frames, pool)
            size, encode, decode = size + part, encode + encode_s, decode + decode_s
            decoded.update(zip(group, frames, strict=True))
    footage, own = views.measure(decoded)
    count = len(decoded)
    return Point("released", qp, size / count / 1000, footage, own, 1e3 * encode / count, 1e3 * decode / count)


def bd_rate(anchor: list[Point], other: list[Point], measure: str) -> float | None:
    """Bjontegaard delta rate in percent over the PSNR range that both curves cover; None without a common range."""
    curves = [monotonic((point.kilobytes, getattr(point, measure)) for point in points) for points in (anchor, other)]
    if min(len(rates) for rates, _ in curves) < 2:
        return None
    low, high = max(psnr[0] for _, psnr in curves), min(psnr[-1] for _, psnr in curves)
    if high - low < 0.01:
        return None
    return float(bjontegaard.bd_rate(*curves[0], *curves[1], **METHOD))


def kilobytes_at(points: list[Point], psnr: float) -> float | None:
    """Rate in KB per frame at a given PSNR to unquantized splats, interpolated in log rate; None outside the range of
    the points."""
    ordered = sorted(points, key=lambda point: point.own_psnr)
    values = [point.own_psnr for point in ordered]
    if not values[0] <= psnr <= values[-1]:
        return None
    return float(np.exp(np.interp(psnr, values, np.log([point.kilobytes for point in ordered]))))


# ---- speed -----------------------------------------------------------------------------------------------------------


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


def speed_rows(group: TakeGroup, work: Path) -> list[str]:
    """Markdown rows: total CPU time of all threads, which other programs hardly affect, and a wall-clock rate last:
    of two groups, from the first frame to the last."""
    rows = []
    for count in SPEED_SPLATS:
        frames = enlarged(list(group.values()), count)
        for profile in OUR_QPS:
            folder = work / "speed"
            shutil.rmtree(folder, ignore_errors=True)
            settings = BakeSettings(profile=profile)
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
            rows.append(
                f"| {count:,} | {profile} | {size / len(frames) / 1000:.0f} | {bake:.0f} ms | "
                f"{min(opens):.0f} ms | {min(decodes):.1f} ms | {np.median(dequantizes):.1f} ms | "
                f"{max(plays):.0f} |"
            )
    return [
        "| splats | profile | KB per frame | bake per frame | open per group | decode per frame | dequantize | frames"
        " per second, file to arrays |",
        "|---|---|---|---|---|---|---|---|",
        *rows,
    ]


# ---- the tables ------------------------------------------------------------------------------------------------------


def table(points: list[Point]) -> list[str]:
    return [
        "| bake | QP | KB per frame | PSNR to footage | PSNR to unquantized | bake per frame | decode per frame |",
        "|---|---|---|---|---|---|---|",
        *(
            f"| {p.name} | {p.qp} | {p.kilobytes:.1f} | {p.footage_psnr:.2f} dB | {p.own_psnr:.2f} dB | "
            f"{p.encode_ms:.0f} ms | {p.decode_ms:.1f} ms |"
            for p in points
        ),
    ]


def comparison(curves: dict[str, list[Point]]) -> list[str]:
    """BD-rate, and bytes at equal quality."""
    anchor = curves["released"]
    lines = ["", "| against `released` | `planes` | `motion` |", "|---|---|---|"]
    for measure, label in (("own_psnr", "PSNR to unquantized"), ("footage_psnr", "PSNR to footage")):
        cells = []
        for name in ("planes", "motion"):
            value = bd_rate(anchor, curves[name], measure)
            cells.append("no common range" if value is None else f"{value:+.0f}%")
        lines.append(f"| BD-rate, {label} | {' | '.join(cells)} |")
    for psnr in (36, 38, 40, 42, 44, 46):
        base = kilobytes_at(anchor, psnr)
        if base is None:
            continue
        cells = []
        for name in ("planes", "motion"):
            value = kilobytes_at(curves[name], psnr)
            cells.append("out of range" if value is None else f"{value:.1f} KB, {value / base:.2f} of it")
        lines.append(f"| at {psnr} dB to unquantized: {base:.1f} KB | {' | '.join(cells)} |")
    return lines


def load_take(path: Path, wanted: list[int] | None) -> tuple[Views, list[TakeGroup]]:
    take = Take.open(path)
    inputs = Inputs(take, load_config(take.config))
    views = Views(inputs)
    groups = []
    for group in inputs.groups:
        if wanted is not None and group.index not in wanted:
            continue
        files = {index: take.trained_frame(group.index, index) for index in group.indices}
        if not all(file.is_file() for file in files.values()):
            fix = "Train it, or select other groups with --groups."
            raise StudioError("benchmark.not_trained", f"group {group.index} is not trained", file=path, fix=fix)
        groups.append({index: read_frame(file) for index, file in files.items()})
        for index, frame in groups[-1].items():
            views.add(index, frame)
    return views, groups


def main(words: Sequence[str] | None = None) -> int:
    """Measure and print the tables; returns the exit status."""
    parser = argparse.ArgumentParser(description="Rate and distortion of baked streams.")
    parser.add_argument("take", type=Path, help="folder of a trained take")
    parser.add_argument("--groups", help="indices of the groups, for example 0,2 (default: all)")
    parser.add_argument("--speed", action="store_true", help="measure times at 60,000 to 300,000 splats instead")
    arguments = parser.parse_args(words)
    wanted = [int(number) for number in arguments.groups.split(",")] if arguments.groups else None
    views, groups = load_take(arguments.take, wanted)
    frames, firsts = sum(map(len, groups)), [next(iter(group.values())) for group in groups]
    trained = _psnr(np.mean([error for *_, error in views.trained]))
    kind = "held-out" if views.inputs.trained_footage.held_out_cameras else "training"
    about = (
        f"groups: {len(groups)}, frames: {frames}; "
        f"{min(map(len, firsts)):,} to {max(map(len, firsts)):,} splats, SH degree {firsts[0].sh_degree}; "
        f"{kind} cameras {', '.join(views.cameras)}, where the trained "
        f"splats have {trained:.2f} dB to the footage. {os.cpu_count()} cores, "
        f"load {os.getloadavg()[0]:.1f} while measuring."
    )
    lines = [about, ""]
    with tempfile.TemporaryDirectory() as name:
        work = Path(name)
        if arguments.speed:
            lines += speed_rows(groups[0], work)
        else:
            curves: dict[str, list[Point]] = {}
            both = {b: [measure_released(groups, views, qp, b, work) for qp in RELEASED_QPS] for b in (False, True)}
            against = bd_rate(both[False], both[True], "own_psnr")
            better = against is not None and against < 0
            curves["released"] = both[better]
            compared = "" if against is None else f" (with them: BD-rate {against:+.0f}% against without)"
            lines[0] += f" `released` {'with' if better else 'without'} B frames{compared}."
            for profile, ours in OUR_QPS.items():
                curves[profile] = []
                for qp in ours:
                    curves[profile].append(measure_ours(groups, views, qp, profile, work))
                    console.print(curves[profile][-1])
            lines += table([point for points in curves.values() for point in points])
            lines += comparison(curves)
    console.print("\n".join(lines), markup=False, highlight=False, soft_wrap=True)
    return 0


if __name__ == "__main__":
    try:
        raise SystemExit(main())
    except StudioError as error:
        console.print(f"error: {error}", style="red")
        raise SystemExit(1) from None
