"""Bakes trained groups to a stream. The stream's folder is replaced as a whole."""

from __future__ import annotations

import os
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pipelines.reports.pictures import draw
from pipelines.stages.base import Context, StageReporter
from pipelines.stages.params import Params, key_of, settings_affecting
from pipelines.stages.summaries import BakeSummary
from pipelines.takes.atomic_files import digest_of_file, link_or_copy, read_model, remove, write_model
from pipelines.takes.frame_files import read_frame
from pipelines.takes.groups import Group
from pipelines.takes.stage_files import BakedGroup
from pipelines.takes.take import group_name

if TYPE_CHECKING:
    from studio.gaussians import Gaussians
    from studio.stream import GroupEntry


class BakeStage:
    """The stage `bake`; its units are groups.

    Groups are baked into a work folder, each with a file that records what it was made from. When all are finished, the
    manifest is written and the folder replaces the old stream. Valid groups of the old stream are reused.
    """

    name = "bake"
    title = "Baking"
    version = 2
    weight = 3.0
    dependencies: tuple[str, ...] = ("train",)

    def params(self, context: Context) -> Params:
        """Encoding settings, and the contents of the manifest."""
        return {
            **settings_affecting(context.config, "videos", "manifest"),
            "frames a second": float(context.footage.raw.fps),
        }

    def results(self, context: Context) -> list[Path]:
        """All files of the stream."""
        return sorted(path for path in context.take.stream.rglob("*") if path.is_file())

    def units(self, context: Context) -> tuple[int, int, str] | None:
        """Groups that are baked with current settings and inputs."""
        groups = context.groups
        return sum(self._place(context, group) is not None for group in groups), len(groups), "groups"

    def run(self, context: Context, reporter: StageReporter) -> BakeSummary:
        """Bake the groups that are missing, then replace the stream."""
        from studio.stream import GroupEntry, write_manifest

        groups = context.groups
        new = self._folder(context)
        new.mkdir(parents=True, exist_ok=True)
        settings = context.config.bake
        entries: list[GroupEntry] = []
        for position, group in enumerate(groups):
            start, stop = position / len(groups), (position + 1) / len(groups)
            place = self._place(context, group)
            if place is None:
                self._bake(context, group, reporter, start, stop)
            elif place != new / group_name(group.index):
                remove(new / group_name(group.index))
                shutil.copytree(place, new / group_name(group.index), copy_function=link_or_copy)
            entries.append(GroupEntry.from_dict(read_model(self._note(context, group), BakedGroup).entry))
            reporter.metrics(
                {"splats": entries[-1].splats, "bytes": entries[-1].bytes, "frames": entries[-1].frame_count},
                group=group.index,
            )
            reporter.progress(stop, f"group {group.index}")
        wanted = {group_name(group.index) for group in groups}
        for path in new.iterdir():
            if path.name not in wanted:
                remove(path)
        manifest = write_manifest(new, entries, context.footage.calibrated.fps, settings, self._metadata(context))
        self._put_in_place(context, new)
        for path in context.take.work(self.name).glob("group_*.json"):
            if path.stem not in wanted:
                remove(path)
        total = manifest.total_bytes
        return BakeSummary(
            groups=len(groups),
            frames=manifest.frame_count,
            bytes=total,
            bytes_per_frame=round(total / manifest.frame_count),
        )

    def _folder(self, context: Context) -> Path:
        return context.take.work(self.name) / "stream"

    def _note(self, context: Context, group: Group) -> Path:
        """File with the key, digests and manifest entry of a baked group."""
        return context.take.work(self.name) / f"{group_name(group.index)}.json"

    def _key(self, context: Context, group: Group) -> str:
        frames = [context.take.trained_frame(group.index, index) for index in group.indices]
        content = [digest_of_file(path) if path.is_file() else None for path in frames]
        return key_of(
            self.name, self.version, settings_affecting(context.config, "videos"), group.index, group.first, content
        )

    def _place(self, context: Context, group: Group) -> Path | None:
        """Folder of a valid baked group, in the work folder or in the old stream; None if it must be baked."""
        if not self._note(context, group).is_file():
            return None
        note = read_model(self._note(context, group), BakedGroup)
        if note.key != self._key(context, group):
            return None
        for folder in (self._folder(context), context.take.stream):
            place = folder / group_name(group.index)
            found = {path.name: path.stat().st_size for path in place.iterdir()} if place.is_dir() else {}
            if found == note.files and all(digest_of_file(place / name) == note.digests[name] for name in found):
                return place
        return None

    def _bake(self, context: Context, group: Group, reporter: StageReporter, start: float, stop: float) -> None:
        from studio.stream import bake_group

        remove(self._note(context, group))
        label = f"group {group.index}"
        entry = bake_group(
            TrainedFrames(context, group),
            self._folder(context),
            group.index,
            group.first,
            context.config.bake,
            progress=reporter.part(label, start, stop),
            quality=DrawnError(context, group) if context.config.bake.target_psnr is not None else None,
            threads=context.config.run.threads,
        )
        files = sorted((self._folder(context) / group_name(group.index)).iterdir())
        write_model(
            self._note(context, group),
            BakedGroup(
                key=self._key(context, group),
                files={path.name: path.stat().st_size for path in files},
                digests={path.name: digest_of_file(path) for path in files},
                entry=entry.to_dict(),
            ),
        )

    def _metadata(self, context: Context) -> dict[str, Any]:
        """Deterministic, so that identical takes bake to identical bytes."""
        footage = context.footage.calibrated
        camera = (*footage.held_out_cameras, *footage.train_cameras)[0]
        return {
            "suggested_camera": footage.rig[camera].to_dict(),
            "background": list(context.config.capture.background),
            "up": [float(value) for value in footage.rig.up],
        }

    def _put_in_place(self, context: Context, new: Path) -> None:
        """Swap folders. If killed between the renames, the complete new stream is still in the work folder."""
        stream = context.take.stream
        old = context.take.work(self.name) / "old"
        remove(old)
        if stream.exists():
            os.rename(stream, old)
        os.rename(new, stream)
        remove(old)


class DrawnError:
    """Image error of decoded frames against trained ones, for `bake.target_psnr`.

    Both are rendered from a few cameras around the performer and compared in the bounding box of the foreground.
    """

    CAMERAS = 4
    WIDTH = 640

    def __init__(self, context: Context, group: Group) -> None:
        self._context, self._group = context, group
        names = context.footage.calibrated.train_cameras
        chosen = np.linspace(0, len(names), min(self.CAMERAS, len(names)), endpoint=False).astype(int)
        self._cameras = [context.footage.calibrated.rig[names[index]] for index in chosen]
        self._trained: dict[int, list[np.ndarray]] = {}

    def __call__(self, index: int, decoded: Gaussians) -> float:
        """Mean squared error over the cameras, colors in 0 to 1; `index` counts within the group."""
        if index not in self._trained:
            path = self._context.take.trained_frame(self._group.index, self._group.indices[index])
            self._trained[index] = self._draw(read_frame(path))
        errors = []
        for trained, found in zip(self._trained[index], self._draw(decoded), strict=True):
            box = drawn_box(trained, self._context.config.capture.background)
            errors.append(float(np.square(trained[box] - found[box]).mean()))
        return sum(errors) / len(errors)

    def _draw(self, gaussians: Gaussians) -> list[np.ndarray]:
        context = self._context
        background = context.config.capture.background
        return [draw(gaussians, camera, background, context.device, self.WIDTH) for camera in self._cameras]


def drawn_box(image: np.ndarray, background: Sequence[float]) -> tuple[slice, slice]:
    """Rows and columns of the bounding box of everything that differs from the background; all if nothing does.

    Args:
        image: (H, W, 3), 0 to 1.
        background: RGB, 0 to 1.
    """
    differs = (np.abs(image - np.array(background, dtype=np.float32)) > 1 / 255).any(axis=2)
    rows, columns = np.flatnonzero(differs.any(axis=1)), np.flatnonzero(differs.any(axis=0))
    if rows.size == 0:
        return slice(None), slice(None)
    return slice(int(rows[0]), int(rows[-1]) + 1), slice(int(columns[0]), int(columns[-1]) + 1)


class TrainedFrames(Sequence["Gaussians"]):
    """The trained frames of a group, read on access."""

    def __init__(self, context: Context, group: Group) -> None:
        self._paths = [context.take.trained_frame(group.index, index) for index in group.indices]

    def __len__(self) -> int:
        return len(self._paths)

    def __getitem__(self, index: Any) -> Any:
        if isinstance(index, slice):
            raise TypeError("trained frames do not support slices")
        return read_frame(self._paths[index])
