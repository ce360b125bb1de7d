"""Size and quality of a take's stream at another QP, measured on one of its groups."""

import tempfile
from dataclasses import dataclass
from functools import partial

from v3studio.pipelines.stages.baking.measures import RenderedError, rendered_contribution
from v3studio.pipelines.stages.baking.plan import Part, group_to_bake, planned_parts, stream_cameras
from v3studio.pipelines.stages.inputs import Inputs
from v3studio.studio.comparison.metrics import HIGHEST_PSNR
from v3studio.studio.errors import StudioError
from v3studio.studio.memory_cache import OnDemand
from v3studio.studio.stream.settings import BakeSettings


@dataclass(frozen=True)
class Trial:
    """The result of a QP: mean bytes of the group's frames, and PSNR in dB, measured as for levels of quality."""

    bytes_per_frame: float
    psnr: float


def longest_part(context: Inputs) -> Part:
    """The longest trained group of a take. A few frames alone would give too much weight to the keyframe."""
    files, _ = context.take.trained_files()
    trained = [part for part in planned_parts(context) if part.indices[-1] < len(files)]
    if not trained:
        problem, fix = "no trained group to bake yet", "Run `v3studio train`."
        raise StudioError("take.not_trained", problem, fix=fix, stage="train")
    return max(trained, key=lambda part: len(part.indices))


def measure(context: Inputs, part: Part, settings: BakeSettings) -> Trial:
    """Bake a group with these settings into a temporary folder, and compare it with the trained frames."""
    from v3studio.studio.stream import bake_group

    frames = OnDemand(part.indices, group_to_bake(context, part).read)
    cameras, fps = stream_cameras(context), float(context.raw_footage.fps)
    quality = RenderedError(frames, cameras, context.config.evaluate.background, context.device)
    seen = partial(rendered_contribution, frames, cameras, context.device, lambda: None)
    with tempfile.TemporaryDirectory() as name:
        entry = bake_group(frames, name, 0, 0, settings, quality=quality, threads=1, fps=fps, contribution=seen)
    psnr = entry.best.psnr_to_trained
    assert psnr is not None
    return Trial(entry.best.bytes / entry.frame_count, min(psnr, HIGHEST_PSNR))
