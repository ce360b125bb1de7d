"""The stage `set`: the splats of the set behind the performer, trained once for the take.

The set in each training camera is its clean plate, or what its footage shows outside of the masks. Held-out cameras
have no part in it. Without an image of the set, the stage says why, and the take has performers only.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from v3studio.pipelines.stages import Executor, stage_named
from v3studio.pipelines.stages.inputs import Inputs
from v3studio.pipelines.stages.params import Params, derived_seed, key_of, settings_affecting
from v3studio.pipelines.stages.reporter import StageReporter
from v3studio.pipelines.takes.authored.edits import edit_params
from v3studio.pipelines.takes.files.json_files import read_model, write_model
from v3studio.pipelines.takes.frames.frame_files import FrameMetadata, read_tensors, write_frame, write_tensors
from v3studio.pipelines.takes.results.records import result_of
from v3studio.pipelines.takes.results.stage_files import SetReport
from v3studio.pipelines.takes.results.summaries import SetSummary
from v3studio.studio.atomic_files import remove

if TYPE_CHECKING:
    from torch import Tensor

STAGE = stage_named("set")


def params(inputs: Inputs) -> Params:
    """The footage with its masks, the settings of the set, and how many frames an estimate has: a take that gets longer
    keeps its set, which all of its frames were trained before."""
    from v3studio.studio.footage.empty_set import MOST_FRAMES

    return {
        "footage": inputs.footage_digest,
        "frames": min(len(inputs.raw_footage.frames), MOST_FRAMES),
        **settings_affecting(inputs.config, "training_views", "set"),
        **edit_params(inputs.edits, "masks"),
    }


def results(inputs: Inputs) -> list[Path]:
    """set/set.json, and the splats if there is a set."""
    take = inputs.take
    there = take.set_report.is_file() and not read_model(take.set_report, SetReport).reason
    return [take.set_report, *([take.set_splats] if there else [])]


def units(inputs: Inputs) -> tuple[int, int, str] | None:
    """None: the stage has no units."""
    return None


def run(inputs: Inputs, reporter: StageReporter, executor: Executor | None) -> SetSummary:
    """Train the set from its plates, or say why there is none."""
    from v3studio.studio.footage.empty_set import no_set

    take, footage, sets = inputs.take, inputs.calibrated_footage, inputs.calibrated_sets
    reporter.progress(0.0, "looking for images of the set")
    reason = "capture.set is none" if inputs.config.capture.set == "none" else no_set(footage, sets)
    if not reason:
        return _train(inputs, reporter, inputs.device if executor is None else "cpu")
    reporter.log(f"no set: {reason}")
    reporter.check()  # before anything is replaced
    take.forget(STAGE.name)
    remove(take.set_splats)
    write_model(take.set_report, SetReport(reason=reason))
    return SetSummary(splats=0, reason=f"none: {reason}")


def _train(inputs: Inputs, reporter: StageReporter, device: str) -> SetSummary:
    from v3studio.studio.scenery.depths import depth_maps
    from v3studio.studio.scenery.set_splats import first_points, plate_psnr, train_set

    take, footage = inputs.take, inputs.calibrated_footage
    cameras = [footage.rig[name] for name in footage.train_cameras]
    plates = {}
    for number, camera in enumerate(cameras):
        reporter.progress(0.1 * number / len(cameras), f"the set in {camera.name}")
        plate = inputs.calibrated_sets.plate(camera.name)
        if plate is not None:
            plates[camera.name] = plate
    cameras = [camera for camera in cameras if camera.name in plates]
    seed = derived_seed(inputs.config.run.seed, STAGE.name)
    maps = depth_maps(plates, cameras, reporter.part("depths", 0.1, 0.25))
    first = first_points(maps, plates, seed)
    key = key_of(STAGE.name, STAGE.version, params(inputs), result_of(take, "calibrate"))
    checkpoint = take.work(STAGE.name) / "checkpoint"

    def keep(step: int, state: dict[str, Tensor]) -> None:
        checkpoint.parent.mkdir(parents=True, exist_ok=True)
        write_tensors(checkpoint, state, FrameMetadata(key=key, step=step))

    splats = train_set(
        plates, cameras, first, maps, tuple(footage.rig),
        dilation=inputs.config.train.dilation, device=device, seed=seed,
        progress=reporter.part("training", 0.25, 0.98), checkpoint=keep, resume=read_tensors(checkpoint, key),
    )  # fmt: skip
    report = SetReport(
        splats=len(splats),
        psnr=plate_psnr(splats, cameras, plates, first.matrices),
        colors={name: tuple(map(tuple, matrix.tolist())) for name, matrix in first.matrices.items()},
    )
    take.forget(STAGE.name)
    write_frame(take.set_splats, splats.to("cpu"), FrameMetadata(key=key))
    write_model(take.set_report, report)
    remove(take.work(STAGE.name))
    reporter.metrics({f"psnr of {name}": value for name, value in report.psnr.items()})
    reporter.progress(1.0, "done")
    return SetSummary(splats=len(splats), psnr=round(sum(report.psnr.values()) / len(report.psnr), 2))
