"""The training views of a frame of the footage."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from v3studio.pipelines.stages.reporter import StageReporter
from v3studio.pipelines.takes.files.json_files import read_model
from v3studio.pipelines.takes.results.stage_files import CameraColors
from v3studio.studio.edits.edit_list import EditList
from v3studio.studio.errors import Message, StudioError

if TYPE_CHECKING:
    from pathlib import Path

    from torch import Tensor

    from v3studio.pipelines.stages.inputs import Inputs
    from v3studio.pipelines.stages.training.seen_sets import SeenSets
    from v3studio.studio.edits import CropBox
    from v3studio.studio.footage import Footage, FootageView
    from v3studio.studio.training import TrainingView
    from v3studio.studio.training.settings import TrainSettings


@dataclass(frozen=True, eq=False)
class ViewReader:
    """Reads training views. `scale`: that of the footage; `box`: masks end outside of it; `edits`: their details are
    marked; `colors`: a (3, 4) float64 matrix by camera. A camera without one is not corrected. `sets`: with splats of
    the set, what each camera sees of it, which masks are doubted by."""

    footage: Footage
    settings: TrainSettings
    device: str
    scale: float
    box: CropBox | None
    edits: EditList
    colors: Mapping[str, Tensor]
    sets: SeenSets | None = None

    @classmethod
    def of(cls, inputs: Inputs, *, before_fits: bool = False, colored: bool = True) -> ViewReader:
        """The reader of a take's views. `before_fits`: with the cameras as calibrated, and without details, as those
        see the footage that are fitted to the cameras; `colored`: with the colors of the cameras, if they have any.
        StudioError if the colors are not there."""
        from v3studio.pipelines.stages.training.seen_sets import SeenSets

        colored = colored and inputs.config.train.camera_colors is not None
        return cls(
            footage=inputs.calibrated_footage if before_fits else inputs.trained_footage,
            settings=inputs.config.train,
            device=inputs.device,
            scale=inputs.config.capture.scale,
            box=inputs.training_box,
            edits=EditList() if before_fits else inputs.edits,
            colors=read_camera_colors(inputs.take.camera_colors) if colored else {},
            sets=SeenSets.of(inputs, before_fits) if inputs.config.train.use_plates else None,
        )

    def views(
        self,
        frame: int,
        reporter: StageReporter,
        reading: Callable[[int, int], None] = lambda number, images: None,
        readers: int = 1,
        cameras: Sequence[str] | None = None,
    ) -> list[TrainingView]:
        """Views of all cameras that see the performer. StudioError if an image cannot be read, or none sees them.

        Args:
            reading: called with images read and images before each image, by any thread; may raise Cancelled.
            readers: cameras that are read in parallel.
            cameras: names; None: the training cameras.
        """
        names = self.footage.train_cameras if cameras is None else cameras

        def read(number: int) -> TrainingView | None:
            reporter.check()
            reading(number, len(names))
            return self._view(names[number], frame)

        views = []
        with ThreadPoolExecutor(min(readers, len(names)), thread_name_prefix="views") as pool:
            futures = [pool.submit(read, number) for number in range(len(names))]
            try:
                for camera, future in zip(names, futures, strict=True):
                    view = future.result()
                    if view is not None:
                        views.append(view)
                        continue
                    problem = f"{camera} does not see the performer in frame {frame}: not used for this frame"
                    fields = {"camera": camera, "frame": int(frame)}
                    reporter.warn(Message("training.not_visible", problem, fields=fields))
            except BaseException:
                pool.shutdown(wait=False, cancel_futures=True)
                raise
        if not views:
            problem = f"no training camera sees the performer in frame {frame}"
            raise StudioError("mask.all_empty", problem, fix="Check the masks.", frame=int(frame))
        return views

    def _view(self, camera: str, frame: int) -> TrainingView | None:
        """The view of a camera; None if it does not see the performer."""
        from v3studio.studio.training import Detail, TrainingView

        footage, settings = self.footage, self.settings
        details = [Detail(*detail) for detail in details_at(self.edits, frame)]
        # first, since what it decodes serves the smaller view, too
        closer = bool(details) and self.scale < 1
        large = within_box(footage.full_size_view(camera, frame), self.box) if closer else None
        view = within_box(footage.view(camera, frame), self.box)
        if not (view.mask > 127).any():
            return None
        if self.sets is not None:
            view = self.sets.doubting(view)
        sampling = settings.chroma_siting != "none"
        chroma = footage.chroma(camera) if sampling else None
        seen = TrainingView.from_view(view, self.device, settings.crop_margin, settings.use_plates, chroma)
        seen = seen.with_color(self.colors[camera]) if camera in self.colors else seen
        seen = seen.with_details(details) if details else seen
        if large is None:
            return seen
        chroma = footage.chroma(camera, full_size=True) if sampling else None
        return seen.with_closer(large, settings.use_plates, chroma)


def read_camera_colors(path: Path) -> dict[str, Tensor]:
    """(3, 4) float64 color matrix by camera. Raises StudioError: `take.file_not_found`, `take.damaged`."""
    import torch

    colors = read_model(path, CameraColors)
    return {name: torch.tensor(matrix, dtype=torch.float64) for name, matrix in colors.cameras.items()}


def details_at(edits: EditList, frame: int) -> list[tuple[tuple[float, float, float], float, float]]:
    """Center, radius and weight of each marked detail in a frame, by its number in the footage."""
    return [(_rounded(mark.at(frame)), mark.radius, mark.weight) for mark in edits.details]


def _rounded(point: np.ndarray) -> tuple[float, float, float]:
    x, y, z = (round(float(value), 6) for value in point)
    return x, y, z


def within_box(view: FootageView, box: CropBox | None) -> FootageView:
    """A view in which the mask ends where the camera does not see the box; None: the view as it is."""
    return view if box is None else replace(view, mask=box.cut(view.camera, view.mask))
