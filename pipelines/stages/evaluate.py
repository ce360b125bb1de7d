"""The stage `evaluate`: renders trained and decoded frames from held-out cameras and compares them with the images."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from functools import cached_property, lru_cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from v3studio.pipelines.config import Config
from v3studio.pipelines.reports.evaluation import render_report, sample_images
from v3studio.pipelines.stages import STAGE_NAMES, Executor, stage_named
from v3studio.pipelines.stages.baking.plan import baked_frames
from v3studio.pipelines.stages.compared_view import ComparedView, compared_cameras, compared_view
from v3studio.pipelines.stages.inputs import Inputs
from v3studio.pipelines.stages.params import Params, key_of, settings_affecting
from v3studio.pipelines.stages.reporter import StageReporter
from v3studio.pipelines.takes.authored.edits import edit_params
from v3studio.pipelines.takes.files.json_files import Result, read_model, write_model
from v3studio.pipelines.takes.frames.edited import EditedGroup
from v3studio.pipelines.takes.frames.groups import Group
from v3studio.pipelines.takes.results.evaluation import (
    MEASURES,
    Contradiction,
    Evaluation,
    EvaluationSummary,
    FrameQuality,
    MaskCheck,
    Protocol,
    Quality,
)
from v3studio.pipelines.takes.results.records import result_of
from v3studio.pipelines.takes.take import group_name
from v3studio.studio.atomic_files import remove, write_text
from v3studio.studio.comparison import (
    LEAST_SHARE,
    CheckedView,
    Residual,
    contradicting_masks,
    flicker_of,
    measure,
)
from v3studio.studio.errors import Message, StudioError
from v3studio.studio.masks.mask_source import evenly_spaced

if TYPE_CHECKING:
    from v3studio.studio.footage import Footage
    from v3studio.studio.perceptual import Lpips
    from v3studio.studio.stream import Manifest, StreamReader

STAGE = stage_named("evaluate")

SHOWN_FRAMES = 4  # frames that the report shows as images, spread over the take
MOST_CHECKED = 32  # cameras whose masks are compared with the footage
_RENDERED = 0.7  # share of a group's work after which masks are compared with the footage
UNCUT = (
    "the splats {before}, against the camera's image: performer, where they are by "
    "mask or by difference from the set; moving, the box around that, padded by 8 px; picture, all of it"
)


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
        **edit_params(inputs.edits, "masks"),
    }


def results(inputs: Inputs) -> list[Path]:
    """evaluation.json and report.html."""
    return [inputs.take.evaluation, inputs.take.report]


def units(inputs: Inputs) -> tuple[int, int, str] | None:
    """None: its groups are only kept while it runs."""
    return None


class EvaluatePlan:
    """The plan of an evaluation: the cameras, the frames of the stream, the groups that have them, and the key of each
    group's results. `here`: on this machine, which may lack the device of the run otherwise."""

    def __init__(self, inputs: Inputs, here: bool = True) -> None:
        self.here = here
        self.inputs, self.take, self.config = inputs, inputs.take, inputs.config
        self.edits, self.all_groups = inputs.edits, inputs.groups
        self.baked = baked_frames(inputs)
        self.footage = inputs.trained_footage
        self.cameras, self.held_out = compared_cameras(self.footage), bool(self.footage.measured_cameras)
        # held-out cameras without masks, whose uncut images are compared with the performer before the set
        self.pictured = () if inputs.scene is None else self.footage.unmasked_cameras
        self.groups = [group for group in self.all_groups if set(group.indices) & set(self.baked)]

    @cached_property
    def key(self) -> str:
        """Digest of everything that the results are made from."""
        results = [result_of(self.take, dependency) for dependency in STAGE.dependencies]
        return key_of(STAGE.name, STAGE.version, params(self.inputs), *results)

    def key_of(self, group: Group) -> str:
        """The key of a group's results."""
        return f"{self.key}-{group.index}"

    def file(self, group: Group) -> Path:
        """The file with the results of a group until the evaluation is complete."""
        return self.take.work(STAGE.name) / f"{group_name(group.index)}.json"

    def measured(self, group: Group) -> MeasuredGroup | None:
        """The results of a group; None if there are none that are up to date."""
        with suppress(StudioError):
            measured = read_model(self.file(group), MeasuredGroup)
            return measured if measured.key == self.key_of(group) else None
        return None

    @cached_property
    def lpips(self) -> Lpips | None:
        """The LPIPS metric, if it is measured. Raises StudioError: its weights or the GPU are missing."""
        return lpips_of(self.config, self.inputs.device if self.here else "cpu")

    def view(self, camera: str, frame: int) -> ComparedView | None:
        """A view of a frame, by its number in the footage; None if the camera does not see the performer."""
        uncut = self.held_out or not self.pictured or camera in self.pictured  # not of training cameras if others are
        return compared_view(self.inputs, camera, frame, uncut)

    @cached_property
    def checked(self) -> tuple[str, ...]:
        """The cameras whose masks are compared with the footage: those that are measured, and of the others so many
        that there are `MOST_CHECKED`."""
        others = [name for name in self.footage.train_cameras if name not in self.cameras]
        some = evenly_spaced(others, max(MOST_CHECKED - len(self.cameras), 0)) if others else []
        return tuple(name for name in self.footage.camera_names if name in {*self.cameras, *some})

    @cached_property
    def evidence(self) -> Literal["set", "masks"]:
        """Return what masks are compared with."""
        return "masks" if self.inputs.sets.plate(self.cameras[0]) is None else "set"

    def contradictions(self, group: Group, tick: Callable[[float], None]) -> tuple[Contradiction, ...]:
        """Return where the masks of a group contradict the footage; `tick` is told how much of it is done, 0 to 1."""

        around = range(group.first - 1, group.first + len(group.frames) + 1)  # also the frames before and after it
        chosen = [int(self.footage.frames[index]) for index in around if index in self.baked]

        def frames(pool: ThreadPoolExecutor) -> Iterator[tuple[int, dict[str, CheckedView]]]:
            for number, frame in enumerate(chosen):
                views = {}
                for place, view in enumerate(pool.map(partial(self._checked_view, frame=frame), self.checked)):
                    tick((number + place / len(self.checked)) / len(chosen))
                    views[view.camera.name] = view
                yield frame, views

        with ThreadPoolExecutor(self.inputs.threads, thread_name_prefix="masks") as pool:
            wrong = contradicting_masks(frames(pool))
        return tuple(Contradiction(**vars(each)) for each in wrong if each.frame in group.frames)

    def _checked_view(self, camera: str, frame: int) -> CheckedView:
        return CheckedView.of(self.footage.view(camera, frame), self.inputs.sets.plate(camera), self.inputs.capture)


def run(inputs: Inputs, reporter: StageReporter, executor: Executor | None) -> EvaluationSummary:
    """Decode, render and compare; write evaluation.json and report.html."""
    plan = EvaluatePlan(inputs, here=executor is None)
    if plan.lpips is not None and plan.lpips.remark:
        reporter.warn(plan.lpips.remark)
    if not plan.held_out:
        problem = (
            f"{_why_none(plan.footage)}, so training cameras are measured: this shows how well the footage is "
            "reproduced, not the quality of new views"
        )
        fix = "Hold out cameras with masks: capture.held_out."
        reporter.warn(Message("evaluation.no_held_out", problem, fix=fix, fields={"setting": "capture.held_out"}))
    if executor is not None:
        executor.run(STAGE, inputs, plan.groups, reporter)
    with _reader(plan) as reader:
        measured = [_measured(plan, group, reporter, reader) for group in plan.groups]
        stream = reader.manifest
    rows = tuple(row for group in measured for row in group.frames)
    _tell_unseen(plan, measured, reporter)
    masks = _mask_check(plan, measured, reporter)
    summary = EvaluationSummary(
        **_means(rows),
        bytes_per_frame=round(stream.played_bytes() / stream.frame_count, 1),
        psnr_trained_lowest_frame=min(row.psnr_trained for row in rows),
        psnr_decoded_lowest_frame=min(row.psnr_decoded for row in rows),
        frames_contradicting_masks=len(masks.frames),
        **_mean_flicker("flicker", rows),
        **_mean_flicker("flicker_at_group_borders", [row for row in rows if row.starts_group]),
    )
    seen = {
        name: [row.cameras[name] for row in rows if name in row.cameras] for name in (*plan.cameras, *plan.pictured)
    }
    evaluation = Evaluation(
        summary=summary,
        protocol=_protocol(plan, stream),
        cameras={name: Quality(**_means(qualities)) for name, qualities in seen.items() if qualities},
        frames=rows,
        masks=masks,
    )
    reporter.progress(0.97, "writing the report")
    before = STAGE_NAMES[: STAGE_NAMES.index(STAGE.name)]
    samples = [images for group in measured for images in group.samples]
    report = render_report(plan.take, plan.config, plan.all_groups, evaluation, samples, before)
    plan.take.forget(STAGE.name)
    write_text(plan.take.report, report)
    write_model(plan.take.evaluation, evaluation)
    remove(plan.take.work(STAGE.name))
    reporter.metrics(summary.to_json())
    reporter.progress(1.0, "done")
    return summary


def _measured(plan: EvaluatePlan, group: Group, reporter: StageReporter, reader: StreamReader) -> MeasuredGroup:
    """The results of a group, measured now unless they are there."""
    with plan.take.group_locked(STAGE.name, group.index, reporter.check):
        measured = plan.measured(group)
        if measured is not None:
            return measured
        start, stop = (0.95 * (group.first + count) / len(plan.footage.frames) for count in (0, len(group.frames)))
        return _measure(plan, group, reporter, reader, start, stop)


def _tell_unseen(plan: EvaluatePlan, measured: Sequence[MeasuredGroup], reporter: StageReporter) -> None:
    """Warn of views without the performer. StudioError: they are in no view."""
    if not any(group.frames for group in measured):
        problem = f"the mask is empty in all frames of {', '.join(plan.cameras)}: nothing to measure"
        fix = "Check the masks, or hold out other cameras."
        raise StudioError(
            "evaluation.nothing_visible", problem, fix=fix, cameras=list(plan.cameras), setting="capture.held_out"
        )
    for index, camera in (unseen for group in measured for unseen in group.unseen):
        frame = int(plan.footage.frames[index])
        problem = f"{camera} does not see the performer in frame {frame}: not measured"
        reporter.warn(Message("evaluation.not_visible", problem, fields={"camera": camera, "frame": frame}))


def _mask_check(plan: EvaluatePlan, measured: Sequence[MeasuredGroup], reporter: StageReporter) -> MaskCheck:
    """The masks' comparison with the footage, with a warning of contradictions."""
    wrong = tuple(each for group in measured for each in group.contradictions)
    check = MaskCheck(evidence=plan.evidence, cameras=plan.checked, least_share=LEAST_SHARE, contradictions=wrong)
    if wrong:
        fields = {
            "frames": list(check.frames),
            "cameras": sorted({each.camera for each in wrong}),
            "share": max(each.share for each in wrong),
        }
        fix = "Correct the masks, and train again."
        reporter.warn(Message("evaluation.masks_contradicted", check.words, fix=fix, fields=fields))
    return check


def _protocol(plan: EvaluatePlan, stream: Manifest) -> Protocol:
    """The protocol, which says how it was measured."""
    footage, settings = plan.footage, plan.config.evaluate
    return Protocol(
        cameras=tuple(plan.cameras),
        held_out=plan.held_out,
        note=_note(footage, plan.take.refined_rig.is_file()),
        resolution={name: (footage.rig[name].width, footage.rig[name].height) for name in plan.cameras},
        crop=f"bounding box of the mask, padded by {settings.crop_padding} px",
        background=settings.background,
        footage="the camera's image composited over the background with the evaluation mask"
        + (", where the camera sees the crop box" if plan.edits.crop is not None else ""),
        uncut=_uncut(plan),
        frames=tuple(int(footage.frames[index]) for index in plan.baked),
        mean="over the views of a frame, then over frames; PSNR of equal images is set to 100 dB",
        ssim="11x11 Gaussian window, sigma 1.5",
        **({} if plan.lpips is None else {"lpips": plan.lpips.protocol}),
        total_bytes=stream.played_bytes(),
        total_bytes_are="all files that playing the best rendition takes, and the manifest, without the set",
        set_bytes=stream.set_bytes,
        bytes_of_a_frame="files of its group, divided by the frames in the group",
    )


def _uncut(plan: EvaluatePlan) -> str | None:
    """Return how splats are compared with the uncut footage; None: they are not."""
    if plan.inputs.scene is None:
        return UNCUT.format(before="over the set, in the camera's brightness") if plan.evidence == "set" else None
    how = UNCUT.format(before="before those of the set")
    how += "; after a color fit, with the 3x4 color matrix that fits the picture best"
    names = ", ".join(plan.pictured)
    return f"{how}; nothing else is measured in {names}, since they have no masks" if names else how


def _why_none(footage: Footage) -> str:
    """Return why no held-out camera is measured."""
    names = footage.held_out_cameras
    return f"held out {', '.join(names)} have no masks" if names else "no camera is held out"


def _note(footage: Footage, refined: bool) -> str:
    """A note on what the cameras have to do with training."""
    if not footage.measured_cameras:
        why = _why_none(footage)
        return f"{why[0].upper()}{why[1:]}: these are the training cameras."
    note = "The cameras were held out from training."
    if refined:
        note += " Training refined its cameras, and each of these was aligned to the splats of the first keyframe."
    return note


def group_key(inputs: Inputs, group: Group) -> str:
    return EvaluatePlan(inputs).key_of(group)


def group_done(inputs: Inputs, group: Group) -> bool:
    return EvaluatePlan(inputs).measured(group) is not None


def run_group(inputs: Inputs, group: Group, reporter: StageReporter) -> None:
    plan = EvaluatePlan(inputs)
    with _reader(plan) as reader:
        _measure(plan, group, reporter, reader, 0.0, 1.0)


class MeasuredGroup(Result):
    """group_NNN.json in `Take.work` of the stage, kept until the evaluation is complete."""

    key: str  # digest of everything that the results were made from
    frames: tuple[FrameQuality, ...]
    unseen: tuple[tuple[int, str], ...]  # index of a frame, and a camera that does not see the performer in it
    contradictions: tuple[Contradiction, ...]
    samples: tuple[dict[str, str], ...]  # images in the report, of one view each: data URIs by label


@contextmanager
def _reader(plan: EvaluatePlan) -> Iterator[StreamReader]:
    """The take's stream. Raises StudioError if it does not have the take's frames, or those of its trim."""
    from v3studio.studio.stream import StreamReader

    with StreamReader.open(plan.take.stream) as reader:
        frames = len(plan.baked)
        if reader.frame_count != frames:
            of_take = f"the take has {frames}" if plan.edits.trim is None else f"the take is trimmed to {frames}"
            problem = f"the stream has {reader.frame_count} frames, but {of_take}"
            fix = "Run `v3studio bake`."
            raise StudioError(
                "stream.frame_count",
                problem,
                file=plan.take.stream,
                value=reader.frame_count,
                fix=fix,
                expected=frames,
            )
        yield reader


def _measure(
    plan: EvaluatePlan, group: Group, reporter: StageReporter, reader: StreamReader, start: float, stop: float
) -> MeasuredGroup:
    """Measure a group and keep the results in the take; `start` and `stop`: of the stage's progress."""
    rows: list[FrameQuality] = []
    unseen: list[tuple[int, str]] = []
    samples: list[dict[str, str]] = []
    baked, cameras = plan.baked, (*plan.cameras, *plan.pictured)
    sizes = {
        frame: entry.bytes / entry.frame_count
        for entry in reader.groups
        for frame in range(entry.first_frame, entry.first_frame + entry.frame_count)
    }
    total = len(baked)
    shown = {baked[at] for at in np.linspace(0, total - 1, min(SHOWN_FRAMES, total)).round().astype(int)}
    edited = EditedGroup(plan.take, group, plan.edits)
    before = _residuals(plan, group.first - 1, reader, reporter)
    for position, (index, frame) in enumerate(zip(group.indices, group.frames, strict=True)):
        if index not in baked:
            continue
        trained = edited.read(index)
        decoded = reader.gaussians(index - baked[0])
        views: dict[str, Quality] = {}
        residuals: dict[str, Residual] = {}
        for number, camera in enumerate(cameras):
            done = _RENDERED * (position + number / len(cameras)) / len(group.frames)
            reporter.progress(start + (stop - start) * done, f"frame {frame}", frame=frame, group=group.index)
            view = plan.view(camera, frame)
            if view is None:
                unseen.append((index, camera))
                continue
            pairs = {"trained": view.pair(trained), "decoded": view.pair(decoded)}
            masked = camera in plan.cameras
            figures = {what: measure(pair, plan.lpips, masked) for what, pair in pairs.items()}
            views[camera] = Quality(
                **{f"{name}_{what}": value for what, values in figures.items() for name, value in values.items()}
            )
            if masked:
                residuals[camera] = pairs["decoded"].residual
            if index in shown and camera in plan.cameras[:3]:
                images = {"footage": pairs["decoded"].footage} | {what: pair.rendered for what, pair in pairs.items()}
                samples.append(sample_images(f"frame {frame}, {camera}", images))
        if not set(views).isdisjoint(plan.cameras):
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

    def tick(done: float) -> None:
        done = _RENDERED + (1 - _RENDERED) * done
        reporter.progress(start + (stop - start) * done, "comparing masks with the footage", group=group.index)

    measured = MeasuredGroup(
        key=plan.key_of(group),
        frames=tuple(rows),
        unseen=tuple(unseen),
        contradictions=plan.contradictions(group, tick),
        samples=tuple(samples),
    )
    write_model(plan.file(group), measured)
    return measured


def _residuals(plan: EvaluatePlan, index: int, reader: StreamReader, reporter: StageReporter) -> dict[str, Residual]:
    """Residuals of one frame by camera; empty if it is not in the stream."""
    residuals: dict[str, Residual] = {}
    if index not in plan.baked:
        return residuals
    decoded = reader.gaussians(index - plan.baked[0])
    for camera in plan.cameras:
        reporter.check()
        view = plan.view(camera, plan.footage.frames[index])
        if view is not None:
            residuals[camera] = view.pair(decoded).residual
    return residuals


def _means(rows: Iterable[Quality]) -> dict[str, float]:
    """Mean of each metric over the rows that have it."""
    taken = [row.measures for row in rows]
    figures = {name: [row[name] for row in taken if name in row] for name in MEASURES}
    return {name: round(sum(column) / len(column), 4) for name, column in figures.items() if column}


def _mean_flicker(name: str, rows: Iterable[FrameQuality]) -> dict[str, float]:
    """Mean over rows, as a field of the summary; empty if there is none."""
    measured = [row.flicker for row in rows if row.flicker is not None]
    return {name: round(sum(measured) / len(measured), 4)} if measured else {}
