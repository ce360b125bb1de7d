"""Bakes a SplatVideo to a stream."""

from pathlib import Path
from typing import Any

from v3studio.studio.errors import StudioError
from v3studio.studio.formats.placing import new_folder
from v3studio.studio.memory_cache import OnDemand
from v3studio.studio.progress import ProgressFn, no_progress
from v3studio.studio.splat_video import SplatVideo
from v3studio.studio.stream import BakeSettings, Manifest, StreamMetadata, bake_group, write_manifest
from v3studio.studio.training.settings import GROUP_SIZE


def cut(video: SplatVideo, group_size: int, first_size: int | None = None) -> list[range]:
    """The groups of the video, split into groups of at most `group_size` frames, the first of at most `first_size`."""
    if group_size < 1:
        problem = f"group size is {group_size}; it must be at least 1"
        raise StudioError("import.invalid_group_size", problem, value=group_size)
    first, *others = [group[at : at + group_size] for group in video.groups for at in range(0, len(group), group_size)]
    return [part for part in (first[:first_size], first[first_size or len(first) :]) if part] + others


def bake_video(
    video: SplatVideo,
    folder: Path | str,
    settings: BakeSettings,
    group_size: int = GROUP_SIZE,
    progress: ProgressFn = no_progress,
    threads: int = 0,
) -> Manifest:
    """Bake all frames to a stream. The folder appears only when it is complete.

    Example:
        >>> video = v3.trained_video("my-take")
        >>> manifest = v3.bake_video(video, "smaller", v3.BakeSettings(quality=30))
        >>> manifest.frame_count, manifest.total_bytes < 100_000
        (5, True)

    Args:
        video: the frames; its groups are kept, but split if they are longer than `group_size`.
        folder: must not exist.
        group_size: maximum number of frames per group.
        progress: called with baked and total frames.
        threads: CPU threads; 0: one per core.

    Raises:
        StudioError: a frame cannot be read or baked, or the folder exists or cannot be written.
    """
    folder = Path(folder)
    up = None if video.up is None else (float(video.up[0]), float(video.up[1]), float(video.up[2]))
    metadata = StreamMetadata(suggested_camera=video.view, background=video.background, up=up, original=video.original)
    with new_folder(folder) as temporary:
        entries = []
        for number, group in enumerate(cut(video, group_size, settings.first_group_size)):

            def report(done: int, total: int, start: int = group.start, **figures: Any) -> None:
                progress(start + done, video.frame_count, **figures)

            frames, start = OnDemand(group, video.read), group.start
            entries.append(
                bake_group(frames, temporary, number, start, settings, report, threads=threads, fps=video.fps)
            )
        return write_manifest(temporary, entries, video.fps, settings, metadata.to_json())
