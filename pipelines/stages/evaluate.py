"""The stage `evaluate`: renders trained and decoded frames from held-out cameras and compares them with the images."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from v3studio.pipelines.config import Config
from v3studio.pipelines.reports.evaluation import render_report, sample_images
from v3studio.pipelines.stages import STAGE_NAMES, Executor, stage_named
from v3studio.pipelines.stages.baking.plan import baked_frames
from v3studio.pipelines.stages.compared_view import compared_cameras, compared_view
from v3studio.pipelines.stages.inputs import Inputs
from v3studio.pipelines.stages.params import Params, key_of, settings_affecting
from v3studio.pipelines.stages.reporter import StageReporter
from v3studio.pipelines.takes.authored.edits import edit_params
from v3studio.pipelines.takes.files.json_files import Result, read_model, write_model
from v3studio.pipelines.takes.frames.edited import EditedGroup
from v3studio.pipelines.takes.frames.groups import Group
from v3studio.pipelines.takes.results.evaluation import (
    MEASURES,
    Evaluation,
    EvaluationSummary,
    FrameQuality,
    Protocol,
    Quality,
)
from v3studio.pipelines.takes.results.records import result_of
from v3studio.pipelines.takes.take import group_name
from v3studio.studio.atomic_files import remove, write_text
from v3studio.studio.comparison import Residual, flicker_of, measure
from v3studio.studio.errors import Message, StudioError

if TYPE_CHECKING:
    from v3studio.studio.footage import Footage
    from v3studio.studio.perceptual import Lpips
    from v3studio.studio.stream import StreamReader

STAGE = stage_named("evaluate")

SHOWN_FRAMES = 4  # frames that the report shows as images, spread over the take


@lru_cache(maxsize=1)
def loaded_lpips(network: Literal["alex", "vgg"], device: str) -> Lpips:
    from v3studio.studio.perceptual import Lpips

    return Lpips(network, device)


def lpips_of(config: Config, device: str) -> Lpips | None:
    """The LPIPS metric, loaded once; None if `evaluate.lpips` is null. Raises StudioError: its weights are missing."""
    return None if config.evaluate.lpips is None else loaded_lpips(config.evaluate.lpips, device)


def params(inputs: Inputs) -> Params:
    """The footage, the metrics, and the settings that affect the comparison."""
    return {
        "metrics": list(MEASURES),
        "footage": inputs.footage_digest,
        "frames": list(inputs.raw_footage.frames),
        **settings_affecting(inputs.config, "evaluation"),
        **edit_params(inputs.edits),
    }


def results(inputs: Inputs) -> list[Path]:
    """evaluation.json and report.html."""
    return [inputs.take.evaluation, inputs.take.report]


def units(inputs: Inputs) -> tuple[int, int, str] | None:
    """None: its groups are only kept while it runs."""
    return None


def run(inputs: Inputs, reporter: StageReporter, executor: Executor | None) -> EvaluationSummary:
    """Decode, render and compare; write evaluation.json and report.html."""
    footage = inputs.trained_footage
    lpips = lpips_of(inputs.config, inputs.device if executor is None else "cpu")
    if lpips is not None and lpips.remark:
        reporter.warn(lpips.remark)
    held_out, cameras = bool(footage.measured_cameras), compared_cameras(footage)
    if not held_out:
        problem = (
            f"{_why_none(footage)}, so training cameras are measured: this shows how well the footage is "
            "reproduced, not the quality of new views"
        )
        fix = "Hold out cameras with masks: capture.held_out."
        reporter.warn(Message("evaluation.no_held_out", problem, fix=fix, fields={"setting": "capture.held_out"}))
    baked = baked_frames(inputs)
    groups = [group for group in inputs.groups if set(group.indices) & set(baked)]
    if executor is not None:
        executor.run(STAGE, inputs, groups, reporter)
    measured: list[MeasuredGroup] = []
    with _reader(inputs) as reader:
        played_bytes, bytes_per_frame = reader.played_bytes, reader.played_bytes / reader.frame_count
        for group in groups:
            with inputs.take.group_locked(STAGE.name, group.index, reporter.check):
                found = _measured(inputs, group)
                if found is None:
                    share = [(group.first + frames) / len(footage.frames) for frames in (0, len(group.frames))]
                    found = _measure(inputs, group, reporter, reader, 0.95 * share[0], 0.95 * share[1])
            measured.append(found)
    rows = tuple(row for one in measured for row in one.frames)
    if not rows:
        problem = f"the mask is empty in all frames of {', '.join(cameras)}: nothing to measure"
        fix = "Check the masks, or hold out other cameras."
        raise StudioError(
            "evaluation.nothing_visible", problem, fix=fix, cameras=list(cameras), setting="capture.held_out"
        )
    for index, camera in (unseen for one in measured for unseen in one.unseen):
        problem = f"{camera} does not see the performer in frame {footage.frames[index]}: not measured"
        reporter.warn(
            Message("evaluation.not_visible", problem, fields={"camera": camera, "frame": int(footage.frames[index])})
        )
    summary = EvaluationSummary(
        **_means(rows),
        bytes_per_frame=round(bytes_per_frame, 1),
        psnr_trained_lowest_frame=min(row.psnr_trained for row in rows),
        psnr_decoded_lowest_frame=min(row.psnr_decoded for row in rows),
        **_mean_flicker("flicker", rows),
        **_mean_flicker("flicker_at_group_borders", [row for row in rows if row.starts_group]),
    )
    protocol = Protocol(
        cameras=tuple(cameras),
        held_out=held_out,
        note=_note(footage, inputs.take.refined_rig.is_file()),
        resolution={name: (footage.rig[name].width, footage.rig[name].height) for name in cameras},
        crop=f"bounding box of the mask, padded by {inputs.config.evaluate.crop_padding} px",
        background=inputs.config.evaluate.background,
        footage="the camera's image composited over the background with the evaluation mask"
        + (", where the camera sees the crop box" if inputs.edits.crop is not None else ""),
        frames=tuple(int(footage.frames[index]) for index in baked),
        mean="over the views of a frame, then over frames; PSNR of equal images is set to 100 dB",
        ssim="11x11 Gaussian window, sigma 1.5",
        **({} if lpips is None else {"lpips": lpips.protocol}),
        total_bytes=played_bytes,
        total_bytes_are="all files that playing the best rendition takes, and the manifest",
        bytes_of_a_frame="files of its group, divided by the frames in the group",
    )
    evaluation = Evaluation(
        summary=summary,
        protocol=protocol,
        cameras={
            name: Quality(**_means([row.cameras[name] for row in rows if name in row.cameras]))
            for name in cameras
            if any(name in row.cameras for row in rows)
        },
        frames=rows,
    )
    reporter.progress(0.97, "writing the report")
    before = STAGE_NAMES[: STAGE_NAMES.index(STAGE.name)]
    samples = [images for one in measured for images in one.samples]
    report = render_report(inputs.take, inputs.config, inputs.groups, evaluation, samples, before)
    inputs.take.forget(STAGE.name)
    write_text(inputs.take.report, report)
    write_model(inputs.take.evaluation, evaluation)
    remove(inputs.take.work(STAGE.name))
    reporter.metrics(summary.to_json())
    reporter.progress(1.0, "done")
    return summary


def _why_none(footage: Footage) -> str:
    """Why no held-out camera is measured."""
    names = footage.held_out_cameras
    return f"held out {', '.join(names)} have no masks" if names else "no camera is held out"


def _note(footage: Footage, refined: bool) -> str:
    """What the cameras have to do with training."""
    if not footage.measured_cameras:
        why = _why_none(footage)
        return f"{why[0].upper()}{why[1:]}: these are the training cameras."
    note = "The cameras were held out from training."
    if refined:
        note += " Training refined its cameras, and each of these was aligned to the splats of the first keyframe."
    return note


def group_key(inputs: Inputs, group: Group) -> str:
    results = [result_of(inputs.take, dependency) for dependency in STAGE.dependencies]
    return f"{key_of(STAGE.name, STAGE.version, params(inputs), *results)}-{group.index}"


def group_done(inputs: Inputs, group: Group) -> bool:
    return _measured(inputs, group) is not None


def run_group(inputs: Inputs, group: Group, reporter: StageReporter) -> None:
    with _reader(inputs) as reader:
        _measure(inputs, group, reporter, reader, 0.0, 1.0)


class MeasuredGroup(Result):
    """group_NNN.json in `Take.work` of the stage, kept until the evaluation is complete."""

    key: str  # digest of everything that the results were made from
    frames: tuple[FrameQuality, ...]
    unseen: tuple[tuple[int, str], ...]  # index of a frame, and a camera that does not see the performer in it
    samples: tuple[dict[str, str], ...]  # images in the report, of one view each: data URIs by label


def _file(inputs: Inputs, group: Group) -> Path:
    return inputs.take.work(STAGE.name) / f"{group_name(group.index)}.json"


def _measured(inputs: Inputs, group: Group) -> MeasuredGroup | None:
    """The results of a group; None if there are none that are up to date."""
    key = group_key(inputs, group)
    with suppress(StudioError):
        found = read_model(_file(inputs, group), MeasuredGroup)
        return found if found.key == key else None
    return None


@contextmanager
def _reader(inputs: Inputs) -> Iterator[StreamReader]:
    """The take's stream. Raises StudioError if it does not have the take's frames, or those of its trim."""
    from v3studio.studio.stream import StreamReader

    with StreamReader.open(inputs.take.stream) as reader:
        frames = len(baked_frames(inputs))
        if reader.frame_count != frames:
            trim = inputs.edits.trim
            of_take = f"the take has {frames}" if trim is None else f"the take is trimmed to {frames}"
            problem = f"the stream has {reader.frame_count} frames, but {of_take}"
            value = reader.frame_count
            fix = "Run `v3studio bake`."
            raise StudioError(
                "stream.frame_count", problem, file=inputs.take.stream, value=value, fix=fix, expected=frames
            )
        yield reader


def _measure(
    inputs: Inputs, group: Group, reporter: StageReporter, reader: StreamReader, start: float, stop: float
) -> MeasuredGroup:
    """Measure a group and keep the results in the take; `start` and `stop`: of the stage's progress."""
    cameras = compared_cameras(inputs.trained_footage)
    rows: list[FrameQuality] = []
    unseen: list[tuple[int, str]] = []
    samples: list[dict[str, str]] = []
    lpips = lpips_of(inputs.config, inputs.device)
    sizes = {
        frame: one.bytes / one.frame_count
        for one in reader.groups
        for frame in range(one.first_frame, one.first_frame + one.frame_count)
    }
    baked = baked_frames(inputs)
    total = len(baked)
    shown = {baked[at] for at in np.linspace(0, total - 1, min(SHOWN_FRAMES, total)).round().astype(int)}
    edited = EditedGroup(inputs.take, group, inputs.edits)
    before = _residuals(inputs, group.first - 1, baked, reader, reporter)
    for position, (index, frame) in enumerate(zip(group.indices, group.frames, strict=True)):
        if index not in baked:
            continue
        trained = edited.read(index)
        decoded = reader.gaussians(index - baked[0])
        views: dict[str, Quality] = {}
        residuals: dict[str, Residual] = {}
        for number, camera in enumerate(cameras):
            done = (position + number / len(cameras)) / len(group.frames)
            reporter.progress(start + (stop - start) * done, f"frame {frame}", frame=frame, group=group.index)
            view = compared_view(inputs, camera, frame)
            if view is None:
                unseen.append((index, camera))
                continue
            pairs = {"trained": view.pair(trained), "decoded": view.pair(decoded)}
            residuals[camera] = pairs["decoded"].residual
            figures = {what: measure(pair, lpips) for what, pair in pairs.items()}
            views[camera] = Quality(
                **{f"{name}_{what}": value for what, found in figures.items() for name, value in found.items()}
            )
            if index in shown and camera in cameras[:3]:
                images = {"footage": pairs["decoded"].footage} | {what: pair.rendered for what, pair in pairs.items()}
                samples.append(sample_images(f"frame {frame}, {camera}", images))
        if views:
            row = FrameQuality(
                index=index,
                frame=int(frame),
                group=group.index,
                starts_group=index == group.first,
                splats=len(trained),
                bytes=round(sizes[index - baked[0]], 1),
                **_means(views.values()),
                flicker=flicker_of(before, residuals),
                cameras=views,
            )
            rows.append(row)
            reporter.metrics(row.measures, group=group.index, frame=frame)
        before = residuals
    measured = MeasuredGroup(
        key=group_key(inputs, group), frames=tuple(rows), unseen=tuple(unseen), samples=tuple(samples)
    )
    write_model(_file(inputs, group), measured)
    return measured


def _residuals(
    inputs: Inputs, index: int, baked: range, reader: StreamReader, reporter: StageReporter
) -> dict[str, Residual]:
    """Residuals of one frame by camera; empty if it is not in the stream."""
    found: dict[str, Residual] = {}
    if index not in baked:
        return found
    decoded = reader.gaussians(index - baked[0])
    for camera in compared_cameras(inputs.trained_footage):
        reporter.check()
        view = compared_view(inputs, camera, inputs.raw_footage.frames[index])
        if view is not None:
            found[camera] = view.pair(decoded).residual
    return found


def _means(rows: Iterable[Quality]) -> dict[str, float]:
    """Mean of each metric over the rows that have it."""
    taken = [row.measures for row in rows]
    values = {name: [row[name] for row in taken if name in row] for name in MEASURES}
    return {name: round(sum(found) / len(found), 4) for name, found in values.items() if found}


def _mean_flicker(name: str, rows: Iterable[FrameQuality]) -> dict[str, float]:
    """Mean over rows, as a field of the summary; empty if there is none."""
    values = [row.flicker for row in rows if row.flicker is not None]
    return {name: round(sum(values) / len(values), 4)} if values else {}
