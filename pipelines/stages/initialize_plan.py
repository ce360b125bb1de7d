"""Plans the initial points of a take: what those of each group are made from, and which are made already."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from v3studio.pipelines.stages import stage_named
from v3studio.pipelines.stages.inputs import Inputs
from v3studio.pipelines.stages.params import key_of, settings_affecting
from v3studio.pipelines.takes.files.digests import digest_of
from v3studio.pipelines.takes.files.json_files import read_model
from v3studio.pipelines.takes.frames.groups import Group
from v3studio.pipelines.takes.results.records import result_of
from v3studio.pipelines.takes.results.stage_files import InitialPointsReport

if TYPE_CHECKING:
    from v3studio.studio.footage import Footage

STAGE = stage_named("initialize")


class InitializePlan:
    """The groups whose keyframes get initial points, and what the points are made from. What calibration wrote is read
    once, on first use."""

    def __init__(self, inputs: Inputs) -> None:
        self.inputs, self.take = inputs, inputs.take
        self.settings = inputs.config.initialize
        self.checks_rig, self.masked = inputs.config.run.check_rig, inputs.config.capture.masks != "none"
        self.seed, self.since = inputs.config.run.seed, inputs.since.get(STAGE.name, 0)
        self.frames, self.box = inputs.raw_footage.frames, inputs.training_box
        self.seen = inputs.seen_by_training()
        self.recipe = {**self.seen, **settings_affecting(inputs.config, "initial_points")}

    @property
    def groups(self) -> tuple[Group, ...]:
        """The take's groups: of any motion until it is found, see `pipelines.stages.grouping`."""
        return self.inputs.groups

    @cached_property
    def footage(self) -> Footage:
        """The footage with the calibrated cameras."""
        return self.inputs.calibrated_footage

    @cached_property
    def cameras(self) -> str | None:
        """Digest of the calibrated cameras."""
        return result_of(self.take, "calibrate")

    @property
    def motion_key(self) -> str:
        """Digest of what the performer's motion is found from."""
        return digest_of([1, self.seen, list(self.frames), self.cameras])

    def key(self, group: Group) -> str:
        """Digest of what the points of a group are made from."""
        return key_of(STAGE.name, STAGE.version, self.recipe, self.cameras, group.index, group.keyframe)

    def is_current(self, path: Path) -> bool:
        """Return whether a file is there that counts."""
        return path.is_file() and path.stat().st_mtime_ns >= self.since

    def is_made(self, group: Group, digest: Callable[[Path], str | None]) -> bool:
        """Return whether a group's report has the current key, and its files are there with the digests in it;
        `digest`: of a file; None if it is taken to be right."""
        folder = self.take.initialize_group(group.index)
        if not self.is_current(folder / "report.json"):
            return False
        report = read_model(folder / "report.json", InitialPointsReport)
        files = {folder / name: value for name, value in report.files.items()}
        return report.key == self.key(group) and all(
            file.is_file() and digest(file) in (None, value) for file, value in files.items()
        )
