"""The footage of a take: opened once, with and without the take's cameras, and what training sees of it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

from pipelines.config import Config
from pipelines.stages.params import Params, settings_affecting
from pipelines.takes.take import Take

if TYPE_CHECKING:
    from studio.cameras import Rig
    from studio.capture import Footage


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
        return self._open(None)

    @cached_property
    def calibrated(self) -> Footage:
        """The footage with the take's cameras.

        Raises:
            StudioError: it cannot be opened, or there are no cameras yet.
        """
        from studio.camera_files import read_rig

        return self._open(read_rig(self.take.rig))

    @cached_property
    def digest(self) -> str:
        """What the files are. All frames count, whichever are used: a longer take keeps what a shorter one made."""
        from studio.capture import open_footage

        everything = self.config.capture.replace(start=None, stop=None, step=1)
        return open_footage(everything, None, strict=False).digest()

    def forget_cameras(self) -> None:
        """Open the footage anew when it is next asked for (cameras have changed)."""
        self.__dict__.pop("calibrated", None)

    def seen_by_training(self) -> Params:
        """The footage and the settings that decide what a training view looks like."""
        return {"footage": self.digest, **settings_affecting(self.config, "training_views")}

    def _open(self, rig: Rig | None) -> Footage:
        from studio.capture import open_footage

        run = self.config.run
        return open_footage(
            self.config.capture, rig, cache_folder=self.take.footage_cache, device=run.device, threads=run.threads
        )
