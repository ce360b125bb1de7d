"""Evaluation: what was trained and what was baked, drawn from held-out cameras and compared with their images."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pipelines.reports.evaluation import Sample, render_report
from pipelines.reports.pictures import draw
from pipelines.stages.base import Context, StageReporter
from pipelines.stages.params import Params, settings_affecting
from pipelines.takes.atomic_files import write_json, write_text
from pipelines.takes.frame_files import read_frame
from pipelines.takes.groups import Group
from studio.errors import StudioError

if TYPE_CHECKING:
    from studio.gaussians import Gaussians

MEASURES = ("psnr_trained", "psnr_decoded", "ssim_trained", "ssim_decoded", "lpips_trained", "lpips_decoded")
"""What a row may hold; the last two only where evaluate.lpips asks for them."""
_HIGHEST_PSNR = 100.0


@dataclass
class Measured:
    """All views' figures, and the pictures that the report shows."""

    frames: list[dict[str, Any]] = field(default_factory=list)
    samples: list[Sample] = field(default_factory=list)
    unseen: list[tuple[int, str]] = field(default_factory=list)


class EvaluateStage:
    """See the module."""

    name = "evaluate"
    title = "Evaluation"
    version = 1
    weight = 5.0
    dependencies: tuple[str, ...] = ("calibrate", "train", "bake")

    def params(self, context: Context) -> Params:
        """The footage and all that decides what is compared."""
        return {
            "footage": context.footage.digest,
            "frames": list(context.footage.raw.frames),
            **settings_affecting(context.config, "evaluation"),
        }

    def results(self, context: Context) -> list[Path]:
        """evaluation.json and report.html."""
        return [context.take.evaluation, context.take.report]

    def units(self, context: Context) -> tuple[int, int, str] | None:
        """All or nothing."""
        return None

    def run(self, context: Context, reporter: StageReporter) -> dict[str, Any]:
        """Decode, draw, compare, write evaluation.json and report.html."""
        from studio.stream import StreamReader

        footage, lpips = context.footage.calibrated, context.lpips
        if lpips is not None and lpips.remark:
            reporter.warn(lpips.remark)
        held_out = bool(footage.held_out_cameras)
        cameras = footage.held_out_cameras or footage.train_cameras
        if not held_out:
            reporter.warn(
                "No camera is held out, so the figures are of cameras that were trained on: they say how well the "
                "footage is reproduced, not how new views look. Hold some out with capture.held_out."
            )
        reader = StreamReader.open(context.take.stream)
        with reader:
            manifest = reader.manifest
            if reader.frame_count != len(footage.frames):
                raise StudioError(
                    f"{context.take.stream}: {reader.frame_count} frames, but the take has {len(footage.frames)}; run "
                    "`v3studio bake`."
                )
            sizes = {
                frame: group.bytes / group.frame_count
                for group in manifest.groups
                for frame in range(group.first_frame, group.first_frame + group.frame_count)
            }
            measured = self._measure(context, reporter, cameras, reader, sizes)
        if not measured.frames:
            raise StudioError(
                f"The performer's mask is empty in all frames of {', '.join(cameras)}, so nothing can be measured; "
                "check the masks or hold out other cameras."
            )
        for index, camera in measured.unseen:
            reporter.warn(f"{camera} does not see the performer in frame {footage.frames[index]}; not measured there.")
        evaluation: dict[str, Any] = {
            "summary": {
                **_means(measured.frames),
                "bytes_per_frame": round(manifest.total_bytes / manifest.frame_count, 1),
                "psnr_trained_lowest_frame": min(row["psnr_trained"] for row in measured.frames),
                "psnr_decoded_lowest_frame": min(row["psnr_decoded"] for row in measured.frames),
            },
            "protocol": {
                "cameras": list(cameras),
                "held_out": held_out,
                "note": (
                    "The cameras were held out: training never saw them."
                    if held_out
                    else "No camera was held out: these are the training cameras."
                ),
                "resolution": {name: [footage.rig[name].width, footage.rig[name].height] for name in cameras},
                "crop": f"bounding box of the performer's mask, padded by {context.config.evaluate.crop_padding} px",
                "background": list(context.config.capture.background),
                "truth": "the camera's image over the background, by the evaluation matte",
                "frames": [int(frame) for frame in footage.frames],
                "mean": "of the views' values, views of a frame first; PSNR of equal images counts as 100 dB",
                "ssim": "11x11 Gaussian window, sigma 1.5",
                **({} if lpips is None else {"lpips": lpips.protocol}),
                "total_bytes": manifest.total_bytes,
                "total_bytes_are": "all videos and the manifest",
                "bytes_of_a_frame": "of its group's videos, divided by the group's frames",
            },
            "cameras": {
                name: _means([row["cameras"][name] for row in measured.frames if name in row["cameras"]])
                for name in cameras
                if any(name in row["cameras"] for row in measured.frames)
            },
            "frames": measured.frames,
        }
        reporter.progress(0.97, "writing the report")
        write_text(
            context.take.report,
            render_report(context.take, context.config, context.groups, evaluation, measured.samples),
        )
        write_json(context.take.evaluation, evaluation)
        reporter.metrics(evaluation["summary"])
        reporter.progress(1.0, "measured")
        return dict(evaluation["summary"])

    def _measure(
        self, context: Context, reporter: StageReporter, cameras: Sequence[str], reader: Any, sizes: dict[int, float]
    ) -> Measured:
        from studio.metrics import psnr, ssim

        measured = Measured()
        total = len(context.footage.raw.frames)
        shown = set(np.linspace(0, total - 1, min(context.config.evaluate.report_frames, total)).round().astype(int))
        for group in context.groups:
            for index, frame in zip(group.indices, group.frames, strict=True):
                trained = read_frame(context.take.trained_frame(group.index, index))
                decoded = reader.gaussians(index)
                views: dict[str, dict[str, float]] = {}
                for number, camera in enumerate(cameras):
                    done = (index + number / len(cameras)) / total
                    reporter.progress(0.95 * done, f"frame {frame}", frame=frame, group=group.index)
                    sample = self._compare(context, camera, frame, trained, decoded)
                    if sample is None:
                        measured.unseen.append((index, camera))
                        continue
                    views[camera] = {}
                    for what in ("trained", "decoded"):
                        image, truth = _tensor(getattr(sample, what)), _tensor(sample.truth)
                        views[camera][f"psnr_{what}"] = round(min(float(psnr(image, truth)), _HIGHEST_PSNR), 4)
                        views[camera][f"ssim_{what}"] = round(float(ssim(image, truth)), 5)
                        if context.lpips is not None:
                            pair = (_at_least(one, context.config.capture.background) for one in (image, truth))
                            views[camera][f"lpips_{what}"] = round(context.lpips(*pair), 5)
                    if index in shown and camera in cameras[:3]:
                        measured.samples.append(sample)
                if views:
                    row = self._row(group, index, frame, views, sizes[index], trained)
                    measured.frames.append(row)
                    reporter.metrics(
                        {name: row[name] for name in MEASURES if name in row}, group=group.index, frame=frame
                    )
        return measured

    def _row(
        self,
        group: Group,
        index: int,
        frame: int,
        views: dict[str, dict[str, float]],
        size: float,
        trained: Gaussians,
    ) -> dict[str, Any]:
        return {
            "index": index,
            "frame": int(frame),
            "group": group.index,
            "keyframe": index == group.first,
            "splats": len(trained),
            "bytes": round(size, 1),
            **_means(views.values()),
            "cameras": views,
        }

    def _compare(
        self, context: Context, camera: str, frame: int, trained: Gaussians, decoded: Gaussians
    ) -> Sample | None:
        """Pictures of one view; None where the camera does not see the performer."""
        footage, settings = context.footage.calibrated, context.config
        view = footage.view(camera, frame)
        matte = footage.evaluation_matte(camera, frame)
        box = padded_box(matte, settings.evaluate.crop_padding)
        if box is None:
            return None
        rows, columns = box
        alpha = matte[rows, columns, None].astype(np.float32) / 255
        background = np.array(settings.capture.background, dtype=np.float32)
        truth = view.image[rows, columns].astype(np.float32) / 255 * alpha + background * (1 - alpha)
        drawn = [
            draw(gaussians, view.camera, settings.capture.background, context.device)[rows, columns]
            for gaussians in (trained, decoded)
        ]
        return Sample(frame, camera, truth, drawn[0], drawn[1])


def padded_box(matte: np.ndarray, padding: int) -> tuple[slice, slice] | None:
    """Rows and columns of the matte above one half, padded and clipped to the image; None if there are none."""
    rows, columns = np.flatnonzero((matte > 127).any(1)), np.flatnonzero((matte > 127).any(0))
    if rows.size == 0:
        return None
    return (
        slice(max(0, int(rows[0]) - padding), min(matte.shape[0], int(rows[-1]) + 1 + padding)),
        slice(max(0, int(columns[0]) - padding), min(matte.shape[1], int(columns[-1]) + 1 + padding)),
    )


def _tensor(image: np.ndarray) -> Any:
    import torch

    return torch.from_numpy(np.ascontiguousarray(image))


def _at_least(image: Any, background: tuple[float, float, float]) -> Any:
    """An (h, w, 3) tensor as large as LPIPS needs: the background goes on to the right and below."""
    from studio.perceptual import SMALLEST

    height, width = image.shape[:2]
    if min(height, width) >= SMALLEST:
        return image
    larger = image.new_tensor(background).repeat(max(height, SMALLEST), max(width, SMALLEST), 1)
    larger[:height, :width] = image
    return larger


def _means(rows: Iterable[dict[str, Any]]) -> dict[str, float]:
    """Mean over rows of each measure that was taken."""
    rows = list(rows)
    return {name: round(sum(row[name] for row in rows) / len(rows), 4) for name in MEASURES if name in rows[0]}
