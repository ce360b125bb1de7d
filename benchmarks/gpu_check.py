"""Does training work on this GPU, and how fast is it? `make gpu-check` runs this.

    python benchmarks/gpu_check.py                 # minutes, at most nine; writes gpu.json and prints a table
    python benchmarks/gpu_check.py --dry-run       # the same code on the CPU, tiny: seconds, figures mean nothing

Needs no network, only the repository, its sample capture, and Triton, a part of PyTorch's CUDA builds for Linux. The
parts:

    kernels      time until the first image is rendered, including compilation; at most four minutes
    tests        the tests that need a CUDA device
    training kernels
                 image loss and loss on coded values: the kernels against their definitions in PyTorch,
                 errors of values and gradients relative to the definition in float64, and milliseconds of both passes
    rasterizer   forward and backward pass, milliseconds
    group        a take of six frames of the sample with the default settings, which are the paper's schedule: the
                 keyframe in the middle, the frames on both sides of it, then 100 joint steps per frame

Training stops when its share of the time is used up; the report then has the frames that are finished. PSNR is the mean
over the held-out cameras, over black, in the padded bounding box of the mask; that of a frame is from before joint
training. `busy` is the mean utilization that nvidia-smi reports while a frame is trained; null without nvidia-smi.

Exit code: 0 if all parts ran, else 1. A part that failed has `error` in the report, and the others still run.
"""

import argparse
import contextlib
import json
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import threading
import time
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_WAIT_POLICY", "passive")  # see studio.process

import torch
from rich.console import Console
from torch import Tensor

from v3studio.pipelines.config import Config, load_config
from v3studio.pipelines.events import Event, Metrics, StageStarted
from v3studio.pipelines.events.cancellation import Cancellation
from v3studio.pipelines.reports.terminal import table_of
from v3studio.pipelines.runs.runner import run
from v3studio.pipelines.stages.inputs import Inputs
from v3studio.pipelines.takes.files.json_files import read_model
from v3studio.pipelines.takes.frames.frame_files import read_frame
from v3studio.pipelines.takes.results.stage_files import TrainedGroup
from v3studio.pipelines.takes.take import Take
from v3studio.studio.comparison import evaluate
from v3studio.studio.errors import Cancelled
from v3studio.studio.footage import Footage
from v3studio.studio.gaussians import Gaussians
from v3studio.studio.training import interframe_steps
from v3studio.studio.training.coded_loss import CodedLoss
from v3studio.studio.training.joint import joint_steps
from v3studio.studio.training.photometric import photometric_loss, photometric_loss_torch

sys.path.insert(0, str(Path(__file__).parent))
from rasterizer import both_function, forward_function, person, time_it

ROOT = Path(__file__).resolve().parents[1]
SECONDS = 510.0  # of the whole check
COMPILING, TESTING = 240.0, 90.0  # Most seconds of these parts. The group gets what is left.
LARGEST_ERROR = 2e-5  # of a training kernel, relative to its result, where the definition in float32 is more exact
JOINT = 100  # joint steps per frame
TINY = {  # settings of a dry run
    "keyframe_iterations": 6,
    "densify_from": 100,
    "prune_finetune_iterations": 3,
    "max_splats": 200,
    "motion_iterations": 4,
    "hash_levels": 2,
    "finetune_iterations": 4,
    "joint_iterations": 2,
}

Report = dict[str, Any]
console = Console(width=112)


class Check:
    """Runs the parts and holds their report; `dry`: on the CPU, tiny."""

    def __init__(self, dry: bool) -> None:
        self.dry, self.ends = dry, time.monotonic() + SECONDS
        self.device, self.backend = ("cpu", "cpu") if dry else ("cuda", "triton")
        self.report: Report = {"dry_run": dry, "machine": machine(), "parts": {}}

    def limit(self, seconds: float) -> float | None:
        """Seconds that a part may take, at least 1; None in a dry run, which may be on a busy machine."""
        return None if self.dry else min(seconds, max(1.0, self.ends - time.monotonic()))

    def part(self, work: Callable[[], Report]) -> bool:
        """Run a part and add it to the report. Returns whether it ran."""
        name = work.__name__.replace("_", " ")
        console.print(f"{name} ...")
        start = time.monotonic()
        try:
            result = work()
        except Exception as error:  # the report must name any failure, and the other parts must run
            result = {"error": f"{type(error).__name__}: {error}"[:2000]}
        self.report["parts"][name] = {"seconds": round(time.monotonic() - start, 2), **result}
        return "error" not in result

    def kernels(self) -> Report:
        """Compile the kernels in a child process, whose compilation can be ended, and render."""
        if self.dry:
            return {"mean_of_image": float(forward_function(*person(100, 64, 64), self.backend)().image.mean())}
        if not torch.cuda.is_available():
            raise RuntimeError("torch finds no CUDA device")
        code = (
            "import sys; sys.path[:0] = sys.argv[1:2]\n"
            "from rasterizer import forward_function, person\n"
            "print(forward_function(*person(100, 64, 64, 'cuda'), 'triton')().image.mean().item())"
        )
        command = [sys.executable, "-c", code, str(Path(__file__).parent)]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=self.limit(COMPILING))
        if done.returncode:
            raise RuntimeError(done.stderr[-1500:])
        return {"mean_of_image": float(done.stdout.split()[-1])}

    def tests(self) -> Report:
        """The tests marked `gpu`; in a dry run they are skipped for want of a GPU."""
        with tempfile.TemporaryDirectory() as folder:
            results = Path(folder) / "tests.xml"
            command = [sys.executable, "-m", "pytest", "-q", "-m", "gpu", f"--junitxml={results}"]
            command += ["-p", "no:cacheprovider", "tests/studio/rasterizer", "tests/studio/training/triton"]
            done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=self.limit(TESTING))
            if not results.is_file():
                raise RuntimeError((done.stdout + done.stderr)[-1500:])
            suite = ElementTree.parse(results).getroot().find("testsuite")
        assert suite is not None
        counts = {name: int(suite.get(name, 0)) for name in ("tests", "failures", "errors", "skipped")}
        failed = [line for line in done.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))]
        if failed or not counts["tests"] or (counts["skipped"] == counts["tests"] and not self.dry):
            return {**counts, "error": "; ".join(failed)[:1500] or "no test ran"}
        return counts

    def training_kernels(self) -> Report:
        """Errors and times of the kernels of training, at the sizes of the sample capture or, dry, at small ones."""
        rows: list[Report] = []
        for name, make in training_cases(self.dry).items():
            _, exact, leaves = make(torch.float64, self.device)
            right = results(exact, leaves)
            kernel, definition, leaves = make(torch.float32, self.device)
            error, usual = (worst_error(results(work, leaves), right) for work in (kernel, definition))
            times = (time_it(partial(results, work, leaves), 15, self.device)[0] for work in (kernel, definition))
            rows.append({"kernel": name, "error": error, "definition_error": usual})
            rows[-1] |= zip(("kernel_ms", "definition_ms"), times, strict=True)
        wrong = [row["kernel"] for row in rows if not row["error"] <= max(4 * row["definition_error"], LARGEST_ERROR)]
        return {"kernels": rows, "error": f"wrong: {', '.join(wrong)}"} if wrong else {"kernels": rows}

    def rasterizer(self) -> Report:
        """Milliseconds of a forward pass, and of both passes, median of 15."""
        cases = ((500, 64, 48),) if self.dry else ((30_000, 480, 270), (100_000, 960, 540), (100_000, 1920, 1080))
        measured: list[Report] = []
        for count, width, height in cases:
            scene = person(count, width, height, self.device)
            measured.append({"splats": count, "width": width, "height": height})
            for time_name, make in (("forward_ms", forward_function), ("both_ms", both_function)):
                measured[-1][time_name] = time_it(make(*scene, self.backend), 15, self.device)[0]
        return {"cases": measured}

    def group(self) -> Report:
        """Train a take, and add its keyframe, its other frames and its joint training as parts of their own."""
        config, stop, parts = settings(self.dry), Cancellation(), self.report["parts"]
        timer = threading.Timer(self.limit(SECONDS) or threading.TIMEOUT_MAX, stop.cancel)
        finished: dict[int, Report] = {}
        with tempfile.TemporaryDirectory() as folder, busy() as utilization:
            take = Take.create(Path(folder) / "take")

            def emit(event: Event) -> None:
                if isinstance(event, StageStarted):
                    used(utilization)
                elif isinstance(event, Metrics) and event.frame is not None:
                    finished[event.frame] = {name: event.values[name] for name in ("seconds", "splats")}
                    finished[event.frame] |= used(utilization)

            timer.daemon = True
            timer.start()
            with contextlib.suppress(Cancelled):
                run(take, config, emit, stages=("calibrate", "initialize", "train"), cancellation=stop)
            if not finished:
                raise RuntimeError("time is up, and the keyframe is not finished")
            joint = {"seconds": read_model(take.train_group(0) / "group.json", TrainedGroup).joint_seconds}
            joint |= used(utilization)
            footage, (group,) = Inputs(take, config).trained_footage, Inputs(take, config).groups
            before, after = [], []
            for frame, part in finished.items():
                path = take.separate_frame(0, frame) if joint["seconds"] else take.trained_frame(0, frame)
                before.append(quality(footage, frame, read_frame(path), self.device))
                after.append(quality(footage, frame, read_frame(take.trained_frame(0, frame)), self.device))
                steps = interframe_steps(config.train, abs(frame - group.keyframe) == 1)
                if frame == group.keyframe:  # which is pruned in one round
                    steps = config.train.keyframe_iterations + config.train.prune_finetune_iterations
                name = "keyframe" if frame == group.keyframe else f"frame {frame}"
                parts[name] = {**part, "steps": steps, "psnr": round(before[-1], 2)}
        result = {"psnr": round(statistics.mean(before), 2)}
        if not joint["seconds"]:
            return {**result, "note": f"time is up after {len(finished)} of {len(group.frames)} frames"}
        steps = joint_steps(config.train, len(finished))
        parts["joint training"] = {**joint, "steps": steps, "psnr": round(statistics.mean(after), 2)}
        return {**result, "note": "PSNR before joint training"}


Computation = tuple[Callable[[], Tensor], Callable[[], Tensor], list[Tensor]]
"""A computation of training: its kernel, its definition, and what gets gradients."""


def results(function: Callable[[], Tensor], leaves: Sequence[Tensor]) -> list[Tensor]:
    """The value of a function, and the gradients of its leaves."""
    value = function()
    upstream = torch.linspace(2.0, 5.0, value.numel(), dtype=value.dtype, device=value.device).reshape(value.shape)
    return [value.detach(), *torch.autograd.grad(value, leaves, upstream)]


def worst_error(found: Sequence[Tensor], right: Sequence[Tensor]) -> float:
    """The largest relative error of a value or a gradient: norm of the difference by norm of the right one."""
    return max(
        float((tensor.double() - other).norm() / other.norm().clamp_min(1e-30))
        for tensor, other in zip(found, right, strict=True)
    )


def training_cases(dry: bool) -> dict[str, Callable[[torch.dtype, str], Computation]]:
    """The computations that have kernels, by name: the same numbers for each dtype and device."""
    random = torch.Generator().manual_seed(1)
    height, width, count = (30, 40, 300) if dry else (1080, 1920, 100_000)
    target = torch.rand(height, width, 3, generator=random)
    image = target + 0.2 * torch.randn(target.shape, generator=random)
    before = torch.randn(count, 14, generator=random) * 20
    now = before + torch.randn(before.shape, generator=random) * 2

    def picture(dtype: torch.dtype, device: str) -> Computation:
        leaf, other = image.to(device, dtype).requires_grad_(), target.to(device, dtype)
        return lambda: photometric_loss(leaf, other), lambda: photometric_loss_torch(leaf, other), [leaf]

    def coded(dtype: torch.dtype, device: str) -> Computation:
        attributes = {"means": slice(0, 3), "rest": slice(3, 14)}
        steps = torch.ones(14, dtype=dtype, device=device)
        loss = CodedLoss(before.to(device, dtype), steps, attributes, 1000, 1e-3, 1e-3).to(device, dtype)
        leaf = now.to(device, dtype).requires_grad_()
        return lambda: loss(leaf, 7)[0], lambda: loss.forward_torch(leaf, 7)[0], [leaf, *loss.parameters()]

    return {"image loss": picture, "coded loss": coded}


def machine() -> Report:
    """GPU, versions and load."""
    facts: Report = {
        "system": platform.platform(),
        "cores": len(os.sched_getaffinity(0)),
        "load": os.getloadavg()[0],
        "torch": torch.__version__,
        "cuda": torch.version.cuda,
        "gpu": torch.cuda.get_device_name() if torch.cuda.is_available() else None,
        "triton": None,
    }
    with contextlib.suppress(PackageNotFoundError):
        facts["triton"] = version("triton")
    return facts


@contextlib.contextmanager
def busy() -> Iterator[Callable[[], Report]]:
    """Within the block, read the GPU's utilization twice a second; the result is the mean in % since its last call."""
    values: list[float] = []
    query = ["nvidia-smi", "--query-gpu=utilization.gpu", "--format=csv,noheader,nounits", "--id=0", "-lms", "500"]
    try:
        process = subprocess.Popen(query, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    except OSError:
        yield lambda: {"gpu_busy_percent": None}
        return

    def read() -> None:
        assert process.stdout is not None
        for line in process.stdout:
            with contextlib.suppress(ValueError):
                values.append(float(line))

    def since_last() -> Report:
        seen = values.copy()
        values.clear()
        return {"gpu_busy_percent": round(statistics.mean(seen), 1) if seen else None}

    reader = threading.Thread(target=read, daemon=True)
    reader.start()
    try:
        yield since_last
    finally:
        process.terminate()
        process.wait()


def used(utilization: Callable[[], Report]) -> Report:
    """Utilization and most memory of the GPU since the last call."""
    peak = None
    if torch.cuda.is_available():
        peak = round(torch.cuda.max_memory_allocated() / 2**20)
        torch.cuda.reset_peak_memory_stats()
    return {**utilization(), "gpu_peak_mib": peak}


def settings(dry: bool) -> Config:
    """The sample capture with its clean plates, and the default settings with joint training."""
    capture = load_config(ROOT / "sample_configs" / "quickstart.yaml").capture.replace(frames=":6")
    if not dry:
        return Config.model_validate({"capture": capture, "train": {"joint_iterations": JOINT}})
    small = {"points": 200, "resolution": 24}
    cameras = [f"cam{number:02d}" for number in (0, 2, 4, 6, 8, 10, 12, 14)]
    capture = capture.replace(frames=":3", scale=0.25, cameras=cameras, held_out=cameras[1:2])
    return Config.model_validate({"capture": capture, "initialize": small, "train": TINY, "run": {"device": "cpu"}})


def quality(footage: Footage, frame: int, splats: Gaussians, device: str) -> float:
    """Mean PSNR of splats in the held-out cameras, dB."""
    by_camera = evaluate(splats, footage, frame, cameras=footage.held_out_cameras, device=device)
    return statistics.mean(figures["psnr"] for figures in by_camera.values())


def show(report: Report) -> None:
    """Print the report as a table."""
    table = table_of("part", "seconds", "steps", "per second", "GPU busy", "peak MiB", "PSNR", "", left=(0, 7))
    table.title = f"{report['machine']['gpu'] or 'CPU'}{', dry run' if report['dry_run'] else ''}"
    for name, part in report["parts"].items():
        steps = part.get("steps")
        cells = [part.get(key) for key in ("gpu_busy_percent", "gpu_peak_mib", "psnr")]
        cells = [steps, steps and round(steps / part["seconds"], 1), *cells]
        note = part.get("error", part.get("note", ""))
        if "cases" in part:
            note = "; ".join(
                f"{case['splats']:,} at {case['width']}x{case['height']}: "
                f"{case['forward_ms']:.2f} ms, with gradients {case['both_ms']:.2f} ms"
                for case in part["cases"]
            )
        if "kernels" in part:
            times = "; ".join(
                f"{kernel['kernel']}: {kernel['kernel_ms']:.2f} ms, in PyTorch {kernel['definition_ms']:.2f} ms"
                for kernel in part["kernels"]
            )
            note = f"{note}; {times}" if note else times
        if "tests" in part:
            note = note or f"{part['tests'] - part['skipped']} passed, {part['skipped']} skipped"
        table.add_row(name, f"{part['seconds']:.1f}", *("" if cell is None else f"{cell:,}" for cell in cells), note)
    console.print(table)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the check. Returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--dry-run", action="store_true", help="on the CPU, tiny")
    parser.add_argument("--out", type=Path, default=Path("gpu.json"), help="report (default: %(default)s)")
    options = parser.parse_args(arguments)
    check = Check(options.dry_run)
    if check.part(check.kernels):
        for work in (check.tests, check.training_kernels, check.rasterizer, check.group):
            check.part(work)
    options.out.write_text(json.dumps(check.report, indent=2) + "\n")
    show(check.report)
    console.print(f"Report: {options.out}")
    return 1 if any("error" in part for part in check.report["parts"].values()) else 0


if __name__ == "__main__":
    sys.exit(main())
