"""The measured quality of a group, kept in the take until the evaluation is complete."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pipelines.reports.evaluation import Sample
from pipelines.takes.atomic_files import Result, read_model, write_model
from pipelines.takes.evaluation import FrameQuality
from pipelines.takes.frame_files import FrameMetadata, read_tensors, write_tensors
from pipelines.takes.take import Take, group_name
from studio.errors import StudioError

if TYPE_CHECKING:
    from torch import Tensor

_IMAGES = ("footage", "trained", "decoded")


@dataclass
class Measured:
    """Results of the comparison. `unseen`: (index, camera) where the camera does not see the performer."""

    frames: list[FrameQuality] = field(default_factory=list)
    samples: list[Sample] = field(default_factory=list)
    unseen: list[tuple[int, str]] = field(default_factory=list)

    def add(self, other: Measured) -> None:
        self.frames += other.frames
        self.samples += other.samples
        self.unseen += other.unseen


class MeasuredGroup(Result):
    """.v3studio/work/evaluate/group_NNN.json; the images of its samples are in a safetensors file beside it."""

    key: str  # digest of everything that the results were made from
    frames: tuple[FrameQuality, ...]
    unseen: tuple[tuple[int, str], ...] = ()  # index of a frame, and a camera that does not see the performer in it
    samples: tuple[tuple[int, str], ...] = ()  # frame number in the footage and camera of each view in the report


def write_measured(take: Take, group: int, key: str, measured: Measured) -> None:
    """Write the results of a group; they are there once this returns, or not at all."""
    import torch

    about = _path(take, group)
    tensors = {
        f"{number}.{what}": torch.from_numpy(np.ascontiguousarray(getattr(sample, what)))
        for number, sample in enumerate(measured.samples)
        for what in _IMAGES
    }
    if tensors:
        write_tensors(about.with_suffix(".safetensors"), tensors, FrameMetadata(key=key, group=group))
    write_model(
        about,
        MeasuredGroup(
            key=key,
            frames=tuple(measured.frames),
            unseen=tuple(measured.unseen),
            samples=tuple((sample.frame, sample.camera) for sample in measured.samples),
        ),
    )


def read_measured(take: Take, group: int, key: str) -> Measured | None:
    """The results of a group; None if there are none that were made from `key`."""
    path = _path(take, group)
    if not path.is_file():
        return None
    try:
        about = read_model(path, MeasuredGroup)
    except StudioError:
        return None
    if about.key != key:
        return None
    tensors = read_tensors(path.with_suffix(".safetensors"), key) if about.samples else {}
    if tensors is None:
        return None
    return Measured(list(about.frames), _samples(about.samples, tensors), list(about.unseen))


def _samples(views: Sequence[tuple[int, str]], tensors: Mapping[str, Tensor]) -> list[Sample]:
    return [
        Sample(frame, camera, *(tensors[f"{number}.{what}"].numpy() for what in _IMAGES))
        for number, (frame, camera) in enumerate(views)
    ]


def _path(take: Take, group: int) -> Path:
    return take.work("evaluate") / f"{group_name(group)}.json"
