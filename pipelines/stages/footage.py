"""The footage of a take: opened once, with and without the take's cameras, and what training sees of it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

from pipelines.config import Config
from pipelines.stages.arguments import capture_spec
from pipelines.stages.params import Params, settings_of, without
from pipelines.takes.take import Take

if TYPE_CHECKING:
    from studio.capture import CaptureSpec, Footage

CAPTURE_FOR_TRAINING_LEAVES = (
    "capture.root", "capture.rig", "capture.fps", "capture.background", "capture.evaluation_mattes",
    "capture.cache_megabytes", "capture.start", "capture.stop", "capture.step",
)  # fmt: skip
"""Settings of the capture that do not change what training sees; which frames it sees is asked of the groups."""


@dataclass
class TakeFootage:
    """A take's footage under some settings."""

    take: Take
    config: Config

    @cached_property
    def raw(self) -> Footage:
        """The footage before calibration: names, frames, images as filmed.

        Raises:
            StudioError: it cannot be opened.
        """
        from studio.capture import open_footage

        return open_footage(self._spec(), None, cache_folder=self.take.footage_cache)

    @cached_property
    def calibrated(self) -> Footage:
        """The footage with the take's cameras.

        Raises:
            StudioError: it cannot be opened, or there are no cameras yet.
        """
        from studio.camera_files import read_rig
        from studio.capture import open_footage

        return open_footage(self._spec(), read_rig(self.take.rig), cache_folder=self.take.footage_cache)

    @cached_property
    def digest(self) -> str:
        """What the files are. All frames count, whichever are used: a longer take keeps what a shorter one made."""
        from studio.capture import open_footage

        spec = replace(self._spec(), start=None, stop=None, step=1)
        return open_footage(spec, None, strict=False).digest()

    def forget_cameras(self) -> None:
        """Open the footage anew when it is next asked for (cameras have changed)."""
        self.__dict__.pop("calibrated", None)

    def seen_by_training(self) -> Params:
        """The footage and the settings that decide what a training view looks like."""
        return {"footage": self.digest, **without(settings_of(self.config, "capture"), *CAPTURE_FOR_TRAINING_LEAVES)}

    def _spec(self) -> CaptureSpec:
        return capture_spec(self.config.capture, self.config.run)
