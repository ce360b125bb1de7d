"""The stage `evaluate`: renders trained and decoded frames from held-out cameras and compares them with the images."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pipelines.reports.evaluation import Sample, render_report
from pipelines.stages.bake import BakeStage
from pipelines.stages.base import Context, StageReporter
from pipelines.stages.evaluated_view import evaluated_cameras, evaluated_view
from pipelines.stages.measured_groups import Measured, read_measured, write_measured
from pipelines.stages.params import Params, key_of, settings_affecting
from pipelines.stages.residuals import Residual, flicker_of
from pipelines.takes.atomic_files import remove, write_model, write_text
from pipelines.takes.edit_params import edit_params
from pipelines.takes.edited import EditedGroup
from pipelines.takes.evaluation import MEASURES, Evaluation, EvaluationSummary, FrameQuality, Protocol, Quality
from pipelines.takes.groups import Group
from pipelines.takes.records import result_of
from studio.comparison import HIGHEST_PSNR
from studio.errors import Message, StudioError

if TYPE_CHECKING:
    from studio.gaussians import Gaussians
    from studio.stream import StreamReader


class EvaluateStage:
    """The stage `evaluate`. What was measured of a group is kept until all groups are measured."""

    name = "evaluate"
    title = "Evaluation"
    version = 1
    weight = 5.0
    dependencies: tuple[str, ...] = ("calibrate", "train", "bake")

    def params(self, context: Context) -> Params:
        """The footage, and the settings that affect the comparison."""
        return {
            "footage": context.footage.digest,
            "frames": list(context.footage.raw.frames),
            **settings_affecting(context.config, "evaluation"),
            **edit_params(context.edits),
        }

    def results(self, context: Context) -> list[Path]:
        """evaluation.json and report.html."""
        return [context.take.evaluation, context.take.report]

    def units(self, context: Context) -> tuple[int, int, str] | None:
        """None: its groups are only kept while it runs."""
        return None

    def run(self, context: Context, reporter: StageReporter) -> EvaluationSummary:
        """Decode, render and compare; write evaluation.json and report.html."""
        footage, lpips = context.footage.calibrated, context.lpips
        if lpips is not None and lpips.remark:
            reporter.warn(lpips.remark)
        held_out, cameras = bool(footage.held_out_cameras), evaluated_cameras(context)
        if not held_out:
            reporter.warn(
                Message(
                    "evaluation.no_held_out",
                    "no camera is held out, so training cameras are measured: this shows how well the footage is "
                    "reproduced, not the quality of new views",
                    fix="Hold out cameras with capture.held_out.",
                    fields={"setting": "capture.held_out"},
                )
            )
        if context.executor is not None:
            kept = set(baked_frames(context))
            groups = [group for group in context.groups if kept & set(group.indices)]
            todo = [group for group in groups if not self.group_done(context, group)]
            if todo:
                context.executor.run(self, context, todo, reporter)
        with self._reader(context) as reader:
            manifest = reader.manifest
            measured = Measured()
            baked = baked_frames(context)
            for group in context.groups:
                if not set(group.indices) & set(baked):
                    continue
                key = self.group_key(context, group)
                found = read_measured(context.take, group.index, key)
                if found is None:
                    with context.take.group_locked(self.name, group.index, context.cancellation.check):
                        found = read_measured(context.take, group.index, key)  # a worker may just have measured it
                        if found is None:
                            share = [(group.first + frames) / len(footage.frames) for frames in (0, len(group.frames))]
                            found = self._measure(context, group, reporter, reader, 0.95 * share[0], 0.95 * share[1])
                            write_measured(context.take, group.index, key, found)
                measured.add(found)
        if not measured.frames:
            raise StudioError(
                "evaluation.nothing_visible",
                f"the mask is empty in all frames of {', '.join(cameras)}: nothing to measure",
                fix="Check the masks, or hold out other cameras.",
                cameras=list(cameras),
                setting="capture.held_out",
            )
        for index, camera in measured.unseen:
            reporter.warn(
                Message(
                    "evaluation.not_visible",
                    f"{camera} does not see the performer in frame {footage.frames[index]}: not measured",
                    fields={"camera": camera, "frame": int(footage.frames[index])},
                )
            )
        summary = EvaluationSummary(
            **_means(measured.frames),
            bytes_per_frame=round(manifest.bytes_per_frame, 1),
            psnr_trained_lowest_frame=min(row.psnr_trained for row in measured.frames),
            psnr_decoded_lowest_frame=min(row.psnr_decoded for row in measured.frames),
            **_mean_flicker("flicker", measured.frames),
            **_mean_flicker("flicker_at_group_borders", [row for row in measured.frames if row.keyframe]),
        )
        protocol = Protocol(
            cameras=tuple(cameras),
            held_out=held_out,
            note="The cameras were held out from training."
            if held_out
            else "No camera was held out: these are the training cameras.",
            resolution={name: (footage.rig[name].width, footage.rig[name].height) for name in cameras},
            crop=f"bounding box of the mask, padded by {context.config.evaluate.crop_padding} px",
            background=context.config.capture.background,
            truth="the camera's image composited over the background with the evaluation mask"
            + (", where the camera sees the crop box" if context.edits.crop is not None else ""),
            frames=tuple(int(footage.frames[index]) for index in baked),
            mean="over the views of a frame, then over frames; PSNR of equal images is set to 100 dB",
            ssim="11x11 Gaussian window, sigma 1.5",
            **({} if lpips is None else {"lpips": lpips.protocol}),
            total_bytes=manifest.played_bytes,
            total_bytes_are="all files that playing the best rendition takes, and the manifest",
            bytes_of_a_frame="videos of its group, divided by the frames in the group",
        )
        evaluation = Evaluation(
            summary=summary,
            protocol=protocol,
            cameras={
                name: Quality(**_means([row.cameras[name] for row in measured.frames if name in row.cameras]))
                for name in cameras
                if any(name in row.cameras for row in measured.frames)
            },
            frames=tuple(measured.frames),
        )
        reporter.progress(0.97, "writing the report")
        write_text(
            context.take.report,
            render_report(context.take, context.config, context.groups, evaluation, measured.samples),
        )
        write_model(context.take.evaluation, evaluation)
        remove(context.take.work(self.name))
        reporter.metrics(summary.to_json())
        reporter.progress(1.0, "done")
        return summary

    def group_key(self, context: Context, group: Group) -> str:
        """See `GroupStage`."""
        return f"{self._key(context)}-{group.index}"

    def group_done(self, context: Context, group: Group) -> bool:
        """See `GroupStage`."""
        return read_measured(context.take, group.index, self.group_key(context, group)) is not None

    def run_group(self, context: Context, group: Group, reporter: StageReporter) -> None:
        """See `GroupStage`."""
        with self._reader(context) as reader:
            found = self._measure(context, group, reporter, reader, 0.0, 1.0)
        write_measured(context.take, group.index, self.group_key(context, group), found)

    def _key(self, context: Context) -> str:
        """Digest of everything that the results of all groups are made from."""
        results = [result_of(context.take, dependency) for dependency in self.dependencies]
        return key_of(self.name, self.version, self.params(context), *results)

    @contextmanager
    def _reader(self, context: Context) -> Iterator[StreamReader]:
        """The take's stream. Raises StudioError if it does not have the take's frames, or those of its trim."""
        from studio.stream import StreamReader

        with StreamReader.open(context.take.stream) as reader:
            frames = len(baked_frames(context))
            if reader.frame_count != frames:
                trim = context.edits.trim
                of_take = f"the take has {frames}" if trim is None else f"the take is trimmed to {frames}"
                raise StudioError(
                    "stream.frame_count",
                    f"the stream has {reader.frame_count} frames, but {of_take}",
                    file=context.take.stream,
                    value=reader.frame_count,
                    fix="Run `v3studio bake`.",
                    expected=frames,
                )
            yield reader

    def _measure(
        self, context: Context, group: Group, reporter: StageReporter, reader: StreamReader, start: float, stop: float
    ) -> Measured:
        from studio.metrics import psnr, ssim

        measured, cameras = Measured(), evaluated_cameras(context)
        sizes = {
            frame: one.bytes / one.frame_count
            for one in reader.manifest.groups
            for frame in range(one.first_frame, one.first_frame + one.frame_count)
        }
        baked = baked_frames(context)
        total = len(baked)
        shown = {
            baked[at]
            for at in np.linspace(0, total - 1, min(context.config.evaluate.report_frames, total)).round().astype(int)
        }
        edited = EditedGroup(context.take, group.index, group.indices, context.edits)
        before = self._residuals(context, group.first - 1, baked, reader)
        for position, (index, frame) in enumerate(zip(group.indices, group.frames, strict=True)):
            if index not in baked:
                continue
            trained = edited.read(index)
            decoded = reader.gaussians(index - baked[0])
            views: dict[str, dict[str, float]] = {}
            residuals: dict[str, Residual] = {}
            for number, camera in enumerate(cameras):
                done = (position + number / len(cameras)) / len(group.frames)
                reporter.progress(start + (stop - start) * done, f"frame {frame}", frame=frame, group=group.index)
                view = evaluated_view(context, camera, frame)
                if view is None:
                    measured.unseen.append((index, camera))
                    continue
                drawn = [view.draw(context, one) for one in (trained, decoded)]
                sample = Sample(frame, camera, view.truth, drawn[0], drawn[1])
                residuals[camera] = view.residual(sample.decoded)
                views[camera] = {}
                for what in ("trained", "decoded"):
                    image, truth = _tensor(getattr(sample, what)), _tensor(sample.truth)
                    views[camera][f"psnr_{what}"] = round(min(float(psnr(image, truth)), HIGHEST_PSNR), 4)
                    views[camera][f"ssim_{what}"] = round(float(ssim(image, truth)), 5)
                    if context.lpips is not None:
                        from studio.perceptual import at_least

                        pair = (at_least(one, context.config.capture.background) for one in (image, truth))
                        views[camera][f"lpips_{what}"] = round(context.lpips(*pair), 5)
                if index in shown and camera in cameras[:3]:
                    measured.samples.append(sample)
            if views:
                row = self._row(group, index, frame, views, sizes[index - baked[0]], trained)
                row = row.model_copy(update={"flicker": flicker_of(before, residuals)})
                measured.frames.append(row)
                reporter.metrics(row.measures, group=group.index, frame=frame)
            before = residuals
        return measured

    def _residuals(self, context: Context, index: int, baked: range, reader: StreamReader) -> dict[str, Residual]:
        """Residuals of one frame by camera; empty if it is not in the stream."""
        found: dict[str, Residual] = {}
        if index not in baked:
            return found
        decoded = reader.gaussians(index - baked[0])
        for camera in evaluated_cameras(context):
            context.cancellation.check()
            view = evaluated_view(context, camera, context.footage.raw.frames[index])
            if view is not None:
                found[camera] = view.residual(view.draw(context, decoded))
        return found

    def _row(
        self,
        group: Group,
        index: int,
        frame: int,
        views: dict[str, dict[str, float]],
        size: float,
        trained: Gaussians,
    ) -> FrameQuality:
        cameras = {name: Quality(**figures) for name, figures in views.items()}
        return FrameQuality(
            index=index,
            frame=int(frame),
            group=group.index,
            keyframe=index == group.first,
            splats=len(trained),
            bytes=round(size, 1),
            **_means(cameras.values()),
            cameras=cameras,
        )


def baked_frames(context: Context) -> range:
    """The frames of the stream, counted from 0 in the take. Raises StudioError as `BakeStage.parts`."""
    parts = BakeStage().parts(context)
    return range(parts[0].first, parts[-1].indices[-1] + 1)


def _tensor(image: np.ndarray) -> Any:
    import torch

    return torch.from_numpy(np.ascontiguousarray(image))


def _means(rows: Iterable[Quality]) -> dict[str, float]:
    """Mean over rows of each metric that was measured."""
    taken = [row.measures for row in rows]
    return {name: round(sum(row[name] for row in taken) / len(taken), 4) for name in MEASURES if name in taken[0]}


def _mean_flicker(name: str, rows: Iterable[FrameQuality]) -> dict[str, float]:
    """Mean over rows, as a field of the summary; empty if there is none."""
    values = [row.flicker for row in rows if row.flicker is not None]
    return {name: round(sum(values) / len(values), 4)} if values else {}
