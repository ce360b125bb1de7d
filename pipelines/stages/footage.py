"""The footage of a take, with and without its cameras."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from pipelines.config import Config
from pipelines.stages.params import Params, settings_affecting
from pipelines.takes.drawn_masks import file_of_garbage, with_garbage_of
from pipelines.takes.edits import edit_params, read_edits
from pipelines.takes.path_here import path_here
from pipelines.takes.take import Take
from studio.camera_files import read_rig
from studio.own_frame import in_own_frame, own_frame
from studio.storage import is_address, mirrored

if TYPE_CHECKING:
    from studio.cameras import Rig
    from studio.capture import CaptureSettings, Footage
    from studio.edits import EditList


@dataclass
class TakeFootage:
    """The footage of a take, opened on first access. `most_cached`: see `open_footage`; with and without cameras."""

    take: Take
    config: Config
    most_cached: int | None = None

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
    def raw(self) -> Footage:
        """The footage without cameras: camera names, frames, original images."""
        return self.opened(None)

    @cached_property
    def calibrated(self) -> Footage:
        """The footage with the take's cameras, in the take's own frame."""
        return self.opened(in_own_frame(read_rig(self.take.rig)))

    @cached_property
    def trained(self) -> Footage:
        """The footage with the cameras that splats are trained and measured with, in the take's own frame: refined ones
        if the take has them, else `calibrated`."""
        if not self.take.refined_rig.is_file():
            return self.calibrated
        return self.opened(own_frame(read_rig(self.take.rig)).rig(read_rig(self.take.refined_rig)))

    @cached_property
    def digest(self) -> str:
        """Digest of all files, also of unused frames: when more frames are used, the results of others stay valid. So
        do they when the take is moved or copied."""
        from studio.capture import open_footage

        everything = self.capture.replace(frames=None)
        garbage = file_of_garbage(self.config.capture, self.take)
        names = {} if garbage is None else {garbage: self.config.capture.garbage_masks or ""}
        return open_footage(everything, None, strict=False, evaluation_masks=self.config.evaluate.exact_masks).digest(
            names
        )

    def forget_cameras(self) -> None:
        """Reopen the footage on next access, after the cameras have changed."""
        self.__dict__.pop("calibrated", None)
        self.__dict__.pop("trained", None)

    def seen_by_training(self) -> Params:
        """The footage's digest, and the settings and the crop box that affect training views."""
        return {
            "footage": self.digest,
            **settings_affecting(self.config, "training_views"),
            **(edit_params(self.edits, "crop") if self.edits.crop is not None and self.edits.crop.training else {}),
        }

    def opened(self, rig: Rig | None) -> Footage:
        """The footage with other cameras; None: without cameras. Raises StudioError: it cannot be opened."""
        from studio.capture import open_footage

        run = self.config.run
        return open_footage(
            self.capture, rig, cache_folder=self.take.footage_cache, device=run.device, threads=run.thread_count,
            most_cached=self.most_cached, every_camera=True, evaluation_masks=self.config.evaluate.exact_masks,
            without_masks=() if rig is None else self.raw.without_masks,
        )  # fmt: skip


def performer_over(footage: Footage, camera: str, frame: int, background: Sequence[float]) -> np.ndarray:
    """The performer as filmed, undistorted, over a background, as in the evaluation: (H, W, 3) uint8 RGB."""
    alpha = footage.evaluation_mask(camera, frame)[..., None].astype(np.float32) / 255
    color = np.array(background, np.float32) * 255
    image = footage.image(camera, frame).astype(np.float32) * alpha + color * (1 - alpha)
    return (image + 0.5).astype(np.uint8)
