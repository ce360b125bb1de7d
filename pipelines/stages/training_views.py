"""The training views of a frame of the footage."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from v3studio.pipelines.stages.inputs import Inputs
from v3studio.pipelines.stages.reporter import StageReporter
from v3studio.pipelines.takes.files.json_files import read_model
from v3studio.pipelines.takes.results.stage_files import CameraColors
from v3studio.studio.edits.edit_list import EditList
from v3studio.studio.errors import Message, StudioError

if TYPE_CHECKING:
    from torch import Tensor

    from v3studio.studio.edits import CropBox
    from v3studio.studio.footage import Footage, FootageView
    from v3studio.studio.training import TrainingView


def training_views(
    inputs: Inputs,
    reporter: StageReporter,
    frame: int,
    reading: Callable[[int, int], None],
    readers: int = 1,
    *,
    footage: Footage | None = None,
    cameras: Sequence[str] | None = None,
    colored: bool = True,
    detailed: bool = True,
) -> list[TrainingView]:
    """Views of all cameras that see the performer. StudioError if an image cannot be read, none sees them, or the
    cameras' colors are not there.

    Args:
        reading: called with images read and images before each image, by any thread; may raise Cancelled.
        readers: cameras that are read in parallel.
        footage: where images and cameras are from; None: `Inputs.trained_footage`.
        cameras: names; None: the training cameras.
        colored: with the cameras' colors, with `train.camera_colors`.
    """
    from v3studio.studio.training import Detail, TrainingView

    footage, settings = footage or inputs.trained_footage, inputs.config.train
    cameras = footage.train_cameras if cameras is None else cameras
    marked = details_at(inputs.edits, frame) if detailed else []
    details = [Detail(*one) for one in marked]
    colors = read_camera_colors(inputs) if colored and settings.camera_colors is not None else {}
    closer = bool(details) and inputs.config.capture.scale < 1

    def read(number: int) -> TrainingView | None:
        reporter.check()
        reading(number, len(cameras))
        name, box = cameras[number], inputs.training_box
        # first, since what it decodes serves the smaller view, too
        large = within_box(footage.full_size_view(name, frame), box) if closer else None
        view = within_box(footage.view(name, frame), box)
        if not (view.mask > 127).any():
            return None
        sampling = settings.chroma_siting != "none"
        chroma = footage.chroma(name) if sampling else None
        seen = TrainingView.from_view(view, inputs.device, settings.crop_margin, settings.use_plates, chroma)
        # a camera that did not see the performer in the frame that was fitted has no matrix
        seen = seen.with_color(colors[name]) if name in colors else seen
        seen = seen.with_details(details) if details else seen
        if large is None:
            return seen
        chroma = footage.chroma(name, full_size=True) if sampling else None
        return seen.with_closer(large, settings.use_plates, chroma)

    views = []
    with ThreadPoolExecutor(min(readers, len(cameras)), thread_name_prefix="views") as pool:
        futures = [pool.submit(read, number) for number in range(len(cameras))]
        try:
            for camera, future in zip(cameras, futures, strict=True):
                found = future.result()
                if found is not None:
                    views.append(found)
                    continue
                problem = f"{camera} does not see the performer in frame {frame}: not used for this frame"
                reporter.warn(Message("training.not_visible", problem, fields={"camera": camera, "frame": int(frame)}))
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
    if not views:
        problem = f"no training camera sees the performer in frame {frame}"
        raise StudioError("mask.all_empty", problem, fix="Check the masks.", frame=int(frame))
    return views


def read_camera_colors(inputs: Inputs) -> dict[str, Tensor]:
    """(3, 4) float64 color matrix by camera. Raises StudioError: `take.file_not_found`, `take.damaged`."""
    import torch

    found = read_model(inputs.take.camera_colors, CameraColors)
    return {name: torch.tensor(matrix, dtype=torch.float64) for name, matrix in found.cameras.items()}


def details_at(edits: EditList, frame: int) -> list[tuple[tuple[float, float, float], float, float]]:
    """Center, radius and weight of each marked detail in a frame, by its number in the footage."""
    return [(_rounded(one.at(frame)), one.radius, one.weight) for one in edits.details]


def _rounded(point: np.ndarray) -> tuple[float, float, float]:
    x, y, z = (round(float(value), 6) for value in point)
    return x, y, z


def within_box(view: FootageView, box: CropBox | None) -> FootageView:
    """A view in which the mask ends where the camera does not see the box; None: the view as it is."""
    return view if box is None else replace(view, mask=box.cut(view.camera, view.mask))
