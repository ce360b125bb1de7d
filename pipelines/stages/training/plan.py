"""Plans the training of a take: what each frame is made from, and which frames are trained already."""

from __future__ import annotations

from collections.abc import Set
from functools import cached_property
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

from v3studio.pipelines.stages import stage_named
from v3studio.pipelines.stages.inputs import Inputs
from v3studio.pipelines.stages.params import key_of, settings_affecting
from v3studio.pipelines.stages.training.group_scheduler import groups_at_once, threads_of_groups
from v3studio.pipelines.stages.training.views import details_at
from v3studio.pipelines.takes.files.json_files import read_model
from v3studio.pipelines.takes.frames.frame_files import has_key
from v3studio.pipelines.takes.frames.groups import Group
from v3studio.pipelines.takes.results.records import result_of
from v3studio.pipelines.takes.results.stage_files import InitialPointsReport, cameras_source
from v3studio.pipelines.takes.take import Take
from v3studio.studio.errors import StudioError

if TYPE_CHECKING:
    from v3studio.studio.footage import Footage
    from v3studio.studio.training.settings import TrainSettings

STAGE = stage_named("train")

_COLORS_VERSION, _REFINEMENT_VERSION = 1, 2  # raised whenever what is fitted to the cameras changes


def refines_cameras(take: Take, settings: TrainSettings) -> bool:
    """Return whether cameras are refined (`train.refine_cameras`): with "auto", those that were calibrated from
    footage."""
    if settings.refine_cameras != "auto":
        return settings.refine_cameras == "always"
    return cameras_source(take) in ("footage", "tie points")


class TrainPlan:
    """The groups to train, the keys of what is fitted to the cameras before them, and the keys of their frames.

    The key of a frame is a digest of everything that it is made from; `pipelines.stages.train` says what that is. What
    earlier stages wrote is read once, on first use: make another plan after they ran.
    """

    def __init__(self, inputs: Inputs) -> None:
        self.inputs, self.take = inputs, inputs.take
        self.settings, self.edits = inputs.config.train, inputs.edits
        self.groups = inputs.groups
        self.seed, self.since = inputs.config.run.seed, inputs.since.get(STAGE.name, 0)
        self.recipe = {**inputs.seen_by_training(), **settings_affecting(inputs.config, "keyframe")}
        if self.settings.use_plates and self.take.set_splats.is_file():
            self.recipe["result of set"] = result_of(self.take, "set")
        self.later = settings_affecting(inputs.config, "later_frames")
        self.joint = settings_affecting(inputs.config, "joint_frames")

    @property
    def footage(self) -> Footage:
        """The footage with the calibrated cameras."""
        return self.inputs.calibrated_footage

    def refuse_without_cameras(self) -> None:
        """Raise StudioError if all cameras are held out."""
        if not self.footage.train_cameras:
            problem = "all cameras are held out; none are left to train on"
            fix = "Remove cameras from capture.held_out."
            raise StudioError("settings.no_training_camera", problem, fix=fix, setting="capture.held_out")

    @cached_property
    def refines(self) -> bool:
        """Tell whether cameras are refined."""
        return refines_cameras(self.take, self.settings)

    @cached_property
    def cameras(self) -> str | None:
        """Digest of the calibrated cameras."""
        return result_of(self.take, "calibrate")

    @cached_property
    def at_once(self) -> int:
        """Number of groups that are trained in parallel in one process."""
        return groups_at_once(self.inputs)

    @cached_property
    def threads(self) -> list[int]:
        """CPU threads of each group, by index."""
        return threads_of_groups(self.inputs)

    @cached_property
    def colors_key(self) -> str | None:
        """Digest of what the colors of the cameras are fitted from; None: they are not wanted."""
        if self.settings.camera_colors is None:
            return None
        return self._fit_key("camera colors", _COLORS_VERSION)

    @cached_property
    def refinement_key(self) -> str | None:
        """Digest of what the cameras are refined from; None: they are not refined."""
        if not self.refines:
            return None
        colors = [] if self.colors_key is None else [self.colors_key]
        return self._fit_key("camera refinement", _REFINEMENT_VERSION, *colors)

    def _fit_key(self, what: str, version: int, *more: str) -> str:
        first = self.groups[0]
        return key_of(what, version, self.recipe, self.cameras, self._initial_files(first), first.keyframe, *more)

    def _initial_files(self, group: Group) -> Any:
        """Digests of a group's initial points, from their report; None if there are none."""
        report = self.take.initialize_group(group.index) / "report.json"
        return read_model(report, InitialPointsReport).files if report.is_file() else None

    def keys(self, group: Group) -> list[str]:
        """Key of each frame of a group, in order, before joint training."""
        fits = [key for key in (self.colors_key, self.refinement_key) if key is not None]
        more = (*fits, *details_at(self.edits, group.keyframe))
        points = self._initial_files(group)
        start = key_of(STAGE.name, STAGE.version, self.recipe, self.cameras, points, group.index, *more)
        keys = {group.middle: key_of(STAGE.name, STAGE.version, start, group.keyframe)}
        for position in chain(*group.sides):
            frame, before = group.frames[position], group.trained_before(position)[-1]
            details = details_at(self.edits, frame)
            keys[position] = key_of(STAGE.name, STAGE.version, keys[before], self.later, frame, *details)
        return [keys[position] for position in range(len(group.frames))]

    def keys_to_write(self, group: Group) -> list[str]:
        """The keys of frames that are trained now: without the group's report they would name other initial points, so
        a StudioError if it is missing, or a network file system does not show it here yet."""
        report = self.take.initialize_group(group.index) / "report.json"
        if not report.is_file():
            problem = "the report of the group's initial points is missing, or this machine does not see it yet"
            fix = "Run again. If that does not help, run `v3studio initialize TAKE --force`."
            raise StudioError("train.no_initial_points", problem, file=report, fix=fix)
        return self.keys(group)

    def final_keys(self, keys: list[str]) -> list[str]:
        """The keys of a group's frames when it is done; `keys`: those before joint training."""
        if not self.settings.joint_iterations or len(keys) == 1:
            return keys
        return [key_of(STAGE.name, STAGE.version, self.joint, keys[0], keys[-1])] * len(keys)

    def frame_paths(self, group: Group) -> list[Path]:
        """The files of a group's frames, in order."""
        return [self.take.trained_frame(group.index, index) for index in group.indices]

    def is_done(self, group: Group) -> bool:
        """Return whether all frames of a group are there and up to date."""
        return self._is_final(group, self.keys(group))

    def _is_final(self, group: Group, keys: list[str]) -> bool:
        pairs = zip(self.frame_paths(group), self.final_keys(keys), strict=True)
        return all(has_key(path, key, self.since) for path, key in pairs)

    def trained(self, group: Group) -> Set[int]:
        """Positions of the group's valid frames that need no missing one; joint training may be missing."""
        keys = self.keys(group)
        if self._is_final(group, keys):
            return set(range(len(keys)))
        valid: set[int] = set()
        for position in chain([group.middle], *group.sides):
            path = self.before_joint(group, position, keys[position])
            if path is not None and valid.issuperset(group.trained_before(position)):
                valid.add(position)
        return valid

    def before_joint(self, group: Group, position: int, key: str) -> Path | None:
        """The file of a frame as it was trained alone, not jointly; None if none has this key."""
        index = group.first + position
        paths = self.take.trained_frame(group.index, index), self.take.separate_frame(group.index, index)
        return next((path for path in paths if has_key(path, key, self.since)), None)
