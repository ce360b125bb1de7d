"""Size and quality of a take's stream at another QP, measured on one of its groups."""

from __future__ import annotations

import math
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from pipelines.stages.baking.measures import RenderedError, rendered_contribution
from pipelines.stages.baking.plan import Part, planned_parts, stream_cameras
from pipelines.stages.inputs import Inputs
from studio.comparison.metrics import HIGHEST_PSNR
from studio.errors import StudioError

if TYPE_CHECKING:
    from studio.stream.settings import BakeSettings

MEASURED_FRAMES = 3
"""Frames of the group whose error is measured: the keyframe, one in the middle, the last."""


@dataclass(frozen=True)
class Trial:
    """What a QP gives.

    Attributes:
        bytes_per_frame: bytes of the group divided by its frames.
        psnr: dB, of the decoded splats' images against those of the trained ones, measured as for
            a target PSNR; mean over the measured frames.
    """

    bytes_per_frame: float
    psnr: float


def longest_part(context: Inputs) -> Part:
    """The longest trained group of a take. A few frames alone would give too much weight to the keyframe."""
    files, _ = context.take.trained_files()
    trained = [part for part in planned_parts(context) if part.indices[-1] < len(files)]
    if not trained:
        raise StudioError("take.not_trained", "no trained group to bake yet", fix="Run Train.")
    return max(trained, key=lambda part: len(part.indices))


def measure(context: Inputs, part: Part, settings: BakeSettings) -> Trial:
    """Bake a group into a temporary folder and compare some of its decoded frames with the trained ones.

    Args:
        context: of the take; its footage gives the cameras that frames are compared from.
        settings: with the QP to try, without targets.
    """
    from pipelines.takes.edited import EditedFrames, EditedGroup
    from studio.stream import StreamReader, bake_group, write_manifest

    frames = EditedFrames(EditedGroup(context.take, part.trained, context.edits), part.indices)
    cameras, background = stream_cameras(context), context.config.evaluate.background
    error = RenderedError(frames, cameras, background, context.device)
    fps = float(context.footage.raw.fps)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "stream"
        entry = bake_group(
            frames,
            folder,
            0,
            0,
            settings,
            threads=1,
            fps=fps,
            contribution=lambda: rendered_contribution(frames, cameras, context.device, lambda: None),
        )
        write_manifest(folder, [entry], fps, settings, {})
        last = len(part.indices) - 1
        measured = sorted({round(last * step / (MEASURED_FRAMES - 1)) for step in range(MEASURED_FRAMES)})
        with StreamReader.open(folder) as reader:
            errors = [error(index, reader.gaussians(index)) for index in measured]
    mean = sum(errors) / len(errors)
    psnr = min(-10 * math.log10(mean), HIGHEST_PSNR) if mean > 0 else HIGHEST_PSNR
    return Trial(entry.best.bytes / entry.frame_count, psnr)
