"""Makes a take of 9,000 frames in 450 groups without training, and measures how long commands take to look at it.

    python benchmarks/long_take.py FOLDER [--groups 450] [--group-size 20] [--splats 8] [--measure-only]

Its footage is a video of a plain color for each of the 16 cameras of the sample capture, and its splats are random.
All records, keys and digests are those that a run writes, so `status` and `evaluate` find the take finished. Its states
are measured one after the other: finished, another QP, and half of the groups trained.
"""

from __future__ import annotations

import argparse
import os
import re
import resource
import shutil
import subprocess
import sys
import time
from pathlib import Path

import av
import cv2
import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

SAMPLE = ROOT / "sample_captures" / "walk16"
SETTINGS = """capture:
  root: {root}
  images: videos/{{camera}}.mp4
  rig: cameras.json
  masks: clean_plate
  clean_plates: clean_plates/{{camera}}.png
  held_out: [cam05, cam12]
initialize: {{points: 100, resolution: 32}}
train: {{group_size: {size}}}
bake: {{preset: ultrafast}}
run: {{threads: 1, preview_seconds: 0}}
"""


def write_footage(folder: Path, frames: int) -> None:
    """A video of a plain color per camera, its plate, and the cameras of the sample capture."""
    for name in ("videos", "clean_plates"):
        (folder / name).mkdir(parents=True)
    rig = SAMPLE / "cameras.json"
    shutil.copyfile(rig, folder / "cameras.json")
    first = next(iter(sorted((SAMPLE / "videos").glob("*.mp4"))))
    video = cv2.VideoCapture(str(first))
    width, height = (int(video.get(size)) for size in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT))
    one, plate = folder / "one.mp4", np.zeros((height, width, 3), np.uint8)
    with av.open(str(one), "w") as output:
        stream = output.add_stream("libx264", rate=25, options={"preset": "ultrafast", "g": "25"})
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        picture = av.VideoFrame.from_ndarray(plate, format="rgb24").reformat(format="yuv420p")
        for number in range(frames):
            picture.pts = number
            output.mux(stream.encode(picture))
        output.mux(stream.encode())
    for path in sorted((SAMPLE / "videos").glob("*.mp4")):
        shutil.copyfile(one, folder / "videos" / path.name)
        cv2.imwrite(str(folder / "clean_plates" / f"{path.stem}.png"), plate)
    one.unlink()


def write_take(folder: Path, groups: int, size: int, splats: int) -> Path:
    """A finished take; see the module. Returns its folder."""
    import torch

    from pipelines.config import load_config
    from pipelines.reports.evaluation import render_report
    from pipelines.runs.staleness import write_record
    from pipelines.stages import stage_named
    from pipelines.stages.inputs import Inputs
    from pipelines.stages.reporter import StageReporter
    from pipelines.takes.atomic_files import digest_of_file, write_model, write_text
    from pipelines.takes.evaluation import Evaluation, EvaluationSummary, FrameQuality, Protocol, Quality
    from pipelines.takes.frame_files import FrameMetadata, write_frame
    from pipelines.takes.settings_file import save_config
    from pipelines.takes.stage_files import InitialPointsReport, TrainedGroup
    from pipelines.takes.take import Take
    from studio.gaussians import Gaussians

    torch.set_num_threads(1)
    folder.mkdir(parents=True)
    write_footage(folder / "footage", groups * size)
    settings = folder / "long.yaml"
    settings.write_text(SETTINGS.format(root=folder / "footage", size=size), encoding="utf-8")
    take = Take.create(folder / "take")
    save_config(take.config, load_config(settings))
    inputs = Inputs(take, load_config(take.config))

    def finish(name: str) -> None:
        stage = stage_named(name)
        write_record(stage, inputs, 1.0, summaries[name])
        print(f"{name} at {time.monotonic() - began:.0f} s", flush=True)

    began = time.monotonic()
    calibrate = stage_named("calibrate")
    summaries = {"calibrate": calibrate.code.run(inputs, StageReporter("calibrate"), None)}
    finish("calibrate")
    take.private.mkdir(exist_ok=True)

    initialize = stage_named("initialize").group_code
    for group in inputs.groups:
        place = take.initialize_group(group.index)
        place.mkdir(parents=True)
        for name in ("mesh.ply", "points.ply"):
            (place / name).write_bytes(os.urandom(1000))
        report = InitialPointsReport(
            key=initialize.group_key(inputs, group),
            keyframe=group.keyframe,
            points=100,
            vertices=100,
            faces=100,
            files={name: digest_of_file(place / name) for name in ("mesh.ply", "points.ply")},
        )
        write_model(place / "report.json", report)
    from pipelines.stages.summaries import InitializeSummary, TrainSummary
    from pipelines.stages.train import frame_keys

    summaries["initialize"] = InitializeSummary(groups=groups, points_per_group=100, faces=(100,) * groups)
    finish("initialize")

    generator = torch.Generator().manual_seed(0)
    for group in inputs.groups:
        keys = frame_keys(inputs, group)
        for index, key, frame in zip(group.indices, keys, group.frames, strict=True):
            body = Gaussians.from_activated(
                means=torch.randn(splats, 3, generator=generator),
                quats=torch.tensor([1.0, 0.0, 0.0, 0.0]).repeat(splats, 1),
                scales=torch.full((splats, 3), 0.05),
                opacities=torch.full((splats,), 0.9),
                sh=torch.randn(splats, 1, 3, generator=generator),
            )
            about = FrameMetadata(key=key, group=group.index, index=index, frame=frame)
            write_frame(take.trained_frame(group.index, index), body, about)
        note = TrainedGroup(group=group.index, first=group.first, frames=group.frames, splats=splats, sh_degree=0)
        write_model(take.train_group(group.index) / "group.json", note)
    summaries["train"] = TrainSummary(groups=groups, frames=groups * size, splats=(splats,) * groups)
    finish("train")

    summaries["bake"] = stage_named("bake").code.run(inputs, StageReporter("bake"), None)
    finish("bake")

    quality = {"psnr_trained": 31.0, "psnr_decoded": 30.5, "ssim_trained": 0.92, "ssim_decoded": 0.91}
    cameras = {name: Quality(**quality) for name in ("cam05", "cam12")}
    rows = tuple(
        FrameQuality(
            **quality, index=index, frame=frame, group=group.index, keyframe=frame == group.keyframe, splats=splats,
            bytes=30000.0, cameras=cameras,
        )
        for group in inputs.groups
        for index, frame in zip(group.indices, group.frames, strict=True)
    )  # fmt: skip
    summary = EvaluationSummary(
        **quality, bytes_per_frame=30000.0, psnr_trained_lowest_frame=30.0, psnr_decoded_lowest_frame=30.0
    )
    words = dict.fromkeys(("note", "crop", "truth", "mean", "ssim", "total_bytes_are", "bytes_of_a_frame"), "made up")
    protocol = Protocol(
        cameras=tuple(cameras), held_out=True, resolution=dict.fromkeys(cameras, (640, 360)),
        background=(0.0, 0.0, 0.0), frames=tuple(row.frame for row in rows), total_bytes=1, **words,
    )  # fmt: skip
    evaluation = Evaluation(summary=summary, protocol=protocol, cameras=cameras, frames=rows)
    write_text(take.report, render_report(take, inputs.config, inputs.groups, evaluation, []))
    write_model(take.evaluation, evaluation)
    summaries["evaluate"] = summary
    finish("evaluate")
    return take.root


def spent(*command: str) -> tuple[float, bytes]:
    """CPU seconds of a program, the least of three, and what it printed."""
    found = []
    for _ in range(3):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        done = subprocess.run([sys.executable, *command], cwd=ROOT, check=True, capture_output=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        found.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    return min(found), done.stdout


OPENING = """
import sys, time
from pathlib import Path
from gui.models.playback.loading import load
from gui.models.stage_rows import assess
from gui.models.evaluation import Evaluation
from pipelines.config import load_config
from pipelines.stages.inputs import Inputs
from pipelines.takes.take import Take
import torch, studio.capture, studio.stream
began = time.process_time()
assert not isinstance(load(sys.argv[1]), str)
take = Take.open(Path(sys.argv[1]))
Evaluation.read(take.evaluation)
opened = time.process_time()
assess(Inputs(take, load_config(take.config)))
print(opened - began, time.process_time() - opened)
"""
"""What the window's threads do when a take is opened: the take with its first frame, and the status of its stages."""


def measure(take: Path) -> None:
    """Print a table."""
    from pipelines.config import load_config
    from pipelines.stages.inputs import Inputs
    from pipelines.takes.take import Take

    config = take / "config.yaml"
    opened = Take.open(take)
    groups = len(Inputs(opened, load_config(config)).groups)
    aside = take / "aside"
    print(f"CPU seconds, each the least of three; load {os.getloadavg()[0]:.1f}")
    print("| state | status | evaluate | open in the window | stages in the window |")
    print("|---|---|---|---|---|")

    def row(state: str, evaluates: bool) -> None:
        cli = ("-m", "pipelines.cli")
        report = f"{spent(*cli, 'evaluate', '--take', str(take))[0]:.2f}" if evaluates else ""
        status, _ = spent(*cli, "status", str(take))
        opening = [float(word) for word in spent("-c", OPENING, str(take))[1].split()[-2:]]
        print(f"| {state} | {status:.2f} | {report} | {opening[0]:.2f} | {opening[1]:.2f} |", flush=True)

    row("finished", True)
    before = config.read_text(encoding="utf-8")
    config.write_text(re.sub(r"(?m)^  qp: .*", "  qp: 30", before), encoding="utf-8")
    row("another QP", False)
    config.write_text(before, encoding="utf-8")
    aside.mkdir()
    moved = [(opened.record("train"), aside / "train.json")]
    for number in range(groups // 2, groups):
        moved.append((opened.train_group(number), aside / f"{number}"))
    for path, other in moved:
        path.rename(other)
    row("half of the groups trained", False)
    for path, other in moved:
        other.rename(path)
    aside.rmdir()


def main() -> None:
    """Make and measure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--groups", type=int, default=450)
    parser.add_argument("--group-size", type=int, default=20)
    parser.add_argument("--splats", type=int, default=8)
    parser.add_argument("--measure-only", action="store_true", help="the take is already there")
    arguments = parser.parse_args()
    folder = arguments.folder.absolute()
    if not arguments.measure_only:
        write_take(folder, arguments.groups, arguments.group_size, arguments.splats)
    measure(folder / "take")


if __name__ == "__main__":
    main()
