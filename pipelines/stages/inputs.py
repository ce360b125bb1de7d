"""The inputs of stages: the take, its settings, its footage and its edits."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

from v3studio.pipelines.config import Config
from v3studio.pipelines.stages.params import Params, settings_affecting
from v3studio.pipelines.takes.authored.drawn_masks import file_of_garbage, with_garbage_of
from v3studio.pipelines.takes.authored.edits import edit_params, read_edits
from v3studio.pipelines.takes.files.json_files import read_model
from v3studio.pipelines.takes.files.path_here import path_here
from v3studio.pipelines.takes.frames.groups import Group, cut_into_groups
from v3studio.pipelines.takes.frames.take_set import take_set
from v3studio.pipelines.takes.results.stage_files import FoundMotion
from v3studio.pipelines.takes.take import Take
from v3studio.studio.camera_files import read_rig
from v3studio.studio.errors import StudioError
from v3studio.studio.own_frame import in_own_frame, own_frame
from v3studio.studio.storage import is_address, mirrored

if TYPE_CHECKING:
    from v3studio.studio.cameras import Rig
    from v3studio.studio.capture import CaptureSettings
    from v3studio.studio.edits import CropBox, EditList
    from v3studio.studio.footage import EmptySets, Footage
    from v3studio.studio.gaussians import Gaussians


@dataclass(eq=False)
class Inputs:
    """A take with its settings; what is read from it is opened on first access. `most_cached`: see `open_footage`; with
    and without cameras. `since`: modification time in ns, by stage, from which on a stage's results count; a stage that
    is not in it uses what there is."""

    take: Take
    config: Config
    most_cached: int | None = None
    since: Mapping[str, int] = field(default_factory=dict)

    @cached_property
    def capture(self) -> CaptureSettings:
        """The settings of the footage, with its folder on this machine: where it is mounted here (`run.paths`), or the
        mirror of a folder in object storage, which is listed on first access (StudioError `storage.*`); and with the
        path of garbage masks in the take."""
        capture = with_garbage_of(self.config.capture, self.take)
        if is_address(capture.root):
            return capture.replace(root=mirrored(capture.root))
        here = path_here(capture.root, self.config.run.paths)
        return capture if here == capture.root else capture.replace(root=here)

    @cached_property
    def edits(self) -> EditList:
        """The take's edits, read on first access, so that a run uses the same ones from its beginning to its end.
        StudioError (`take.edits_*`) if they cannot be read."""
        return read_edits(self.take.edits)

    @cached_property
    def raw_footage(self) -> Footage:
        """The footage without cameras: camera names, frames, original images."""
        return self.opened(None)

    @cached_property
    def calibrated_footage(self) -> Footage:
        """The footage with the take's cameras, in the take's own frame."""
        return self.opened(in_own_frame(read_rig(self.take.rig)))

    @cached_property
    def trained_footage(self) -> Footage:
        """The footage with the cameras that splats are trained and measured with, in the take's own frame: refined ones
        if the take has them, else `calibrated_footage`."""
        if not self.take.refined_rig.is_file():
            return self.calibrated_footage
        return self.opened(own_frame(read_rig(self.take.rig)).rig(read_rig(self.take.refined_rig)))

    @cached_property
    def calibrated_sets(self) -> EmptySets:
        """Return what is behind the performer in each camera of `calibrated_footage`."""
        from v3studio.studio.footage import EmptySets

        return EmptySets(self.calibrated_footage)

    @cached_property
    def sets(self) -> EmptySets:
        """Return what is behind the performer in each camera of `trained_footage`."""
        from v3studio.studio.footage import EmptySets

        return EmptySets(self.trained_footage) if self.take.refined_rig.is_file() else self.calibrated_sets

    @cached_property
    def scene(self) -> Gaussians | None:
        """The splats of the set in the world of the stream; None if there is none. Raises StudioError: damage."""
        from v3studio.studio.formats.rigid_motion import placed

        splats = take_set(self.take)
        return None if splats is None else placed(splats, self.edits.similarity)

    @cached_property
    def footage_digest(self) -> str:
        """Digest of all files, also of unused frames: when more frames are used, the results of others stay valid. So
        do they when the take is moved or copied."""
        from v3studio.studio.footage import open_footage

        everything = self.capture.replace(frames=None)
        garbage = file_of_garbage(self.config.capture, self.take)
        names = {} if garbage is None else {garbage: self.config.capture.garbage_masks or ""}
        return open_footage(everything, None, strict=False, evaluation_masks=self.config.evaluate.exact_masks).digest(
            names
        )

    def forget_cameras(self) -> None:
        """Reopen the footage on next access, after the cameras have changed."""
        for name in ("calibrated_footage", "trained_footage", "calibrated_sets", "sets"):
            self.__dict__.pop(name, None)

    def seen_by_training(self) -> Params:
        """The footage's digest, and the settings and the edits that affect training views."""
        return {
            "footage": self.footage_digest,
            **settings_affecting(self.config, "training_views"),
            **edit_params(self.edits, "masks", *(["crop"] if self.training_box else [])),
        }

    def opened(self, rig: Rig | None, votes: bool = True) -> Footage:
        """The footage with other cameras; None: without cameras. `votes`: see `open_footage`. Raises StudioError: it
        cannot be opened."""
        from v3studio.studio.footage import open_footage

        run = self.config.run
        return open_footage(
            self.capture, rig, cache_folder=self.take.footage_cache, device=run.device, threads=run.thread_count,
            most_cached=self.most_cached, every_camera=True, evaluation_masks=self.config.evaluate.exact_masks,
            without_masks=() if rig is None else self.raw_footage.without_masks,
            mask_clicks=() if rig is None else self.edits.masks,  # so that cameras stay as they are
            votes=votes,
        )  # fmt: skip

    @property
    def training_box(self) -> CropBox | None:
        """The crop box, if training sees only what is in front of it."""
        crop = self.edits.crop
        return crop if crop is not None and crop.training else None

    @property
    def groups(self) -> tuple[Group, ...]:
        """The take's frames in groups: as if nobody moved until `pipelines.stages.grouping` knows how they do."""
        path, frames = self.take.motion, self.raw_footage.frames
        stored = read_model(path, FoundMotion) if path.is_file() else FoundMotion()
        known = stored.frames == frames
        return cut_into_groups(frames, self.config.train.group_size, stored.motion if known else None)

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

    from v3studio.studio.rasterizer import preferred_device

    if name == "auto":
        return preferred_device().type
    if name.startswith("cuda"):
        count = torch.cuda.device_count() if torch.cuda.is_available() else 0
        if int(name.partition(":")[2] or 0) >= count:
            present = f"torch found {count} GPUs, numbered from 0" if count else "torch found no GPU"
            problem = f"run.device is {name}, but {present}"
            fix = "Set run.device to cpu or auto."
            raise StudioError("run.no_gpu", problem, value=name, fix=fix, setting="run.device", gpus=count)
    return name
