"""What stages read: the take, its settings, its footage and its edits."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

from pipelines.config import Config
from pipelines.stages.footage import TakeFootage
from pipelines.takes.atomic_files import read_model
from pipelines.takes.groups import Group, cut_into_groups
from pipelines.takes.stage_files import FoundMotion
from pipelines.takes.take import Take
from studio.errors import StudioError

if TYPE_CHECKING:
    from studio.edits import CropBox, EditList


@dataclass(eq=False)
class Inputs:
    """A take with its settings; what is read from it is opened on first access. `most_cached`: see `TakeFootage`."""

    take: Take
    config: Config
    most_cached: int | None = None

    @cached_property
    def footage(self) -> TakeFootage:
        return TakeFootage(self.take, self.config, self.most_cached)

    @property
    def edits(self) -> EditList:
        """The take's edits; see `TakeFootage.edits`."""
        return self.footage.edits

    @property
    def training_box(self) -> CropBox | None:
        """The crop box, if training sees only what is in front of it."""
        crop = self.edits.crop
        return crop if crop is not None and crop.training else None

    @property
    def groups(self) -> tuple[Group, ...]:
        """The take's frames in groups: as if nobody moved until `pipelines.stages.grouping` knows how they do."""
        path, frames = self.take.motion, self.footage.raw.frames
        found = read_model(path, FoundMotion) if path.is_file() else FoundMotion()
        known = found.frames == frames
        return cut_into_groups(frames, self.config.train.group_size, found.motion if known else None)

    @property
    def threads(self) -> int:
        return self.config.run.thread_count

    @cached_property
    def device(self) -> str:
        """torch device for training and rendering: "cpu", "cuda" or "cuda:1". Raises StudioError: `run.no_gpu`."""
        return choose_device(self.config.run.device)


def choose_device(name: str) -> str:
    """An available torch device: "cpu", "cuda" or "cuda:N" for one of these or "auto"."""
    import torch

    from studio.rasterizer import preferred_device

    if name == "auto":
        return preferred_device().type
    if name.startswith("cuda"):
        count = torch.cuda.device_count() if torch.cuda.is_available() else 0
        if int(name.partition(":")[2] or 0) >= count:
            found = f"torch found {count} GPUs, numbered from 0" if count else "torch found no GPU"
            problem = f"run.device is {name}, but {found}"
            fix = "Set run.device to cpu or auto."
            raise StudioError("run.no_gpu", problem, value=name, fix=fix, setting="run.device", gpus=count)
    return name
