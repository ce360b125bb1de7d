"""A SplatVideo from elsewhere to a stream folder."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from studio.errors import StudioError
from studio.export.placing import new_folder
from studio.gaussians import Gaussians
from studio.progress import ProgressFn, no_progress
from studio.splat_video import SplatVideo
from studio.stream import BakeSettings, Manifest, bake_group, write_manifest


class _Frames(Sequence[Gaussians]):
    """A run of frames, each read when it is asked for."""

    def __init__(self, video: SplatVideo, indices: range) -> None:
        self._video = video
        self._indices = indices

    def __len__(self) -> int:
        return len(self._indices)

    def __getitem__(self, position: Any) -> Any:
        if isinstance(position, slice):
            raise StudioError("Frames are read one by one, not by slices.")
        return self._video.read(self._indices[position])

    def __iter__(self) -> Iterator[Gaussians]:
        return (self._video.read(index) for index in self._indices)


def cut(video: SplatVideo, group_size: int) -> list[range]:
    """The video's groups, cut further into groups of at most `group_size` frames."""
    if group_size < 1:
        raise StudioError(f"Groups of {group_size} frames were asked for; a group has at least one.")
    return [group[start : start + group_size] for group in video.groups for start in range(0, len(group), group_size)]


def bake_video(
    video: SplatVideo,
    folder: Path,
    settings: BakeSettings,
    group_size: int = 20,
    progress: ProgressFn = no_progress,
    threads: int = 0,
) -> Manifest:
    """Bake all frames to a stream that appears at `folder` when it is complete.

    Args:
        video: frames; its own groups are kept, and cut where they are longer than `group_size`.
        folder: must not exist.
        settings: as for every bake.
        group_size: frames a group at most.
        progress: called with frames baked, of all.
        threads: CPU threads; 0: one per core.

    Raises:
        StudioError: a frame cannot be read or baked, or the folder exists or cannot be written.
    """
    metadata: dict[str, Any] = {"background": list(video.background)}
    if video.up is not None:
        metadata["up"] = [float(value) for value in video.up]
    if video.view is not None:
        metadata["suggested_camera"] = video.view.to_dict()
    with new_folder(folder) as temporary:
        entries = []
        for number, group in enumerate(cut(video, group_size)):

            def told(done: int, total: int, start: int = group.start, **figures: Any) -> None:
                progress(start + done, video.frame_count, **figures)

            entries.append(
                bake_group(_Frames(video, group), temporary, number, group.start, settings, told, threads=threads)
            )
        return write_manifest(temporary, entries, video.fps, settings, metadata)
