"""Points for each group's keyframe: masks, visual hull, surface, samples."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pipelines.stages import grouping
from pipelines.stages.base import Context, StageReporter
from pipelines.stages.params import Params, derived_seed, key_of, settings_affecting
from pipelines.takes.atomic_files import atomic_path, digest_of_file, read_json, remove, write_json
from pipelines.takes.groups import Group
from pipelines.takes.point_files import write_mesh, write_points
from pipelines.takes.records import result_of

if TYPE_CHECKING:
    from studio.capture import Footage, FootageView


class TrainingViews(Sequence["FootageView"]):
    """The training cameras' views of one frame, read when asked for: a large rig does not fit into memory at once."""

    def __init__(self, footage: Footage, frame: int) -> None:
        self._footage, self._frame = footage, frame

    def __len__(self) -> int:
        return len(self._footage.train_cameras)

    def __getitem__(self, index: Any) -> Any:
        cameras = self._footage.train_cameras[index]
        if isinstance(index, slice):
            return [self._footage.view(camera, self._frame) for camera in cameras]
        return self._footage.view(cameras, self._frame)


class InitializeStage:
    """See the module. A unit is a group."""

    name = "initialize"
    title = "Initial points"
    version = 1
    weight = 6.0
    dependencies: tuple[str, ...] = ("calibrate",)

    def params(self, context: Context) -> Params:
        """What training sees, how hulls are carved, and where groups begin."""
        return {
            **context.footage.seen_by_training(),
            **settings_affecting(context.config, "initial_points"),
            "keyframes": [group.keyframe for group in context.groups],
            **({} if context.config.train.grouping == "fixed" else {"groups by motion": grouping.key(context.footage)}),
        }

    def results(self, context: Context) -> list[Path]:
        """mesh.ply and points.ply of each group."""
        return [
            context.take.initialize_group(group.index) / name
            for group in context.groups
            for name in ("mesh.ply", "points.ply")
        ]

    def units(self, context: Context) -> tuple[int, int, str] | None:
        """Groups whose points stand."""
        groups = context.groups
        return sum(self._is_done(context, group) for group in groups), len(groups), "groups"

    def run(self, context: Context, reporter: StageReporter) -> dict[str, Any]:
        """Make what is missing."""
        first = 0.0 if grouping.is_known(context.footage) else 0.3
        grouping.find_groups(context.footage, reporter.part("looking where groups begin", 0.0, first))
        groups = context.groups
        counts = []
        for position, group in enumerate(groups):
            start, stop = (first + (1 - first) * (position + step) / len(groups) for step in (0, 1))
            if not self._is_done(context, group):
                self._make(context, group, reporter, start, stop, f"group {group.index}")
            counts.append(read_json(context.take.initialize_group(group.index) / "report.json")["faces"])
        self._drop_leftovers(context, groups)
        return {"groups": len(groups), "points_per_group": context.config.initialize.points, "faces": counts}

    def _key(self, context: Context, group: Group) -> str:
        parts = {**context.footage.seen_by_training(), **settings_affecting(context.config, "initial_points")}
        return key_of(self.name, self.version, parts, result_of(context.take, "calibrate"), group.index, group.keyframe)

    def _is_done(self, context: Context, group: Group) -> bool:
        """Its report carries this recipe's key and the digests of the files beside it."""
        folder = context.take.initialize_group(group.index)
        if not (folder / "report.json").is_file():
            return False
        report = read_json(folder / "report.json")
        if report.get("key") != self._key(context, group):
            return False
        files = report.get("files", {})
        return all(
            (folder / name).is_file() and digest_of_file(folder / name) == value for name, value in files.items()
        )

    def _make(
        self, context: Context, group: Group, reporter: StageReporter, start: float, stop: float, label: str
    ) -> None:
        from studio.meshing import initialize_points

        found = initialize_points(
            TrainingViews(context.footage.calibrated, group.keyframe),
            context.config.initialize,
            seed=derived_seed(context.config.run.seed, self.name, group.index),
            progress=reporter.part(f"{label}: visual hull", start, stop),
        )
        for warning in found.warnings:
            reporter.warn(f"Group {group.index}: {warning}")
        folder = context.take.initialize_group(group.index)
        folder.mkdir(parents=True, exist_ok=True)
        remove(folder / "report.json")
        with atomic_path(folder / "mesh.ply") as temporary:
            write_mesh(temporary, found.mesh.vertices, found.mesh.faces)
        with atomic_path(folder / "points.ply") as temporary:
            write_points(temporary, found.points, found.normals, np.round(found.colors * 255))
        report = {
            "key": self._key(context, group),
            "keyframe": group.keyframe,
            "points": len(found.points),
            "vertices": len(found.mesh.vertices),
            "faces": len(found.mesh.faces),
            "disagreement": {camera: round(float(value), 4) for camera, value in found.disagreement.items()},
            "warnings": [str(warning) for warning in found.warnings],
            "files": {name: digest_of_file(folder / name) for name in ("mesh.ply", "points.ply")},
        }
        write_json(folder / "report.json", report)
        reporter.metrics({name: report[name] for name in ("points", "faces", "disagreement")}, group=group.index)

    def _drop_leftovers(self, context: Context, groups: tuple[Group, ...]) -> None:
        wanted = {context.take.initialize_group(group.index) for group in groups}
        for folder in context.take.folder("initialize").glob("group_*"):
            if folder not in wanted:
                remove(folder)
