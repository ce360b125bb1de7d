"""Reading the layout of the paper's released code (see `studio.export.videogs`), as its baker or ours wrote it.

The released baker names frames in `viewer_min_max.json` by their number in the footage instead of counting from 0; both
are understood.
"""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import torch

from studio.errors import StudioError
from studio.gaussians import Gaussians
from studio.splat_video import SplatVideo

DEFAULT_FPS = 30.0
"""The layout has no rate."""

MAX_FRAMES = 1_000_000
MAX_SPLATS = 4 << 20
_DEGREES = {17: 0, 26: 1, 41: 2, 62: 3}  # by the number of attributes
_JPEG_RANGE = 2  # luma uses 0 to 255


def is_videogs(folder: Path) -> bool:
    """True for a folder with the layout's two JSON files."""
    return (folder / "group_info.json").is_file() and (folder / "viewer_min_max.json").is_file()


class _Frame:
    """One entry of viewer_min_max.json, checked."""

    def __init__(self, where: str, entry: Any) -> None:
        count = entry.get("num") if isinstance(entry, dict) else None
        info = entry.get("info") if isinstance(entry, dict) else None
        if not isinstance(count, int) or isinstance(count, bool) or not 0 < count <= MAX_SPLATS:
            raise StudioError(f"{where}: 'num' is {count!r}; it must be a number of splats from 1 to {MAX_SPLATS}.")
        try:
            ranges = np.array(info, np.float64).reshape(-1, 2)
        except (TypeError, ValueError):
            raise StudioError(f"{where}: 'info' must be a list of minima and maxima.") from None
        if len(ranges) not in _DEGREES:
            raise StudioError(f"{where}: 'info' has {2 * len(ranges)} values; 34, 52, 82 or 124 are understood.")
        if not np.isfinite(ranges).all() or (ranges[:, 0] > ranges[:, 1]).any():
            raise StudioError(f"{where}: 'info' has a value that is not finite, or a minimum above its maximum.")
        self.count = count
        self.ranges = ranges

    @property
    def degree(self) -> int:
        return _DEGREES[len(self.ranges)]


def open_videogs(folder: Path, fps: float = DEFAULT_FPS) -> SplatVideo:
    """The layout in a folder as a video; frames are decoded when they are read, in order cheapest.

    Raises:
        StudioError: a JSON file is missing or damaged, groups have gaps, or values are out of bounds. Reading a frame
            raises it for a video that is missing, damaged or too short.
    """
    groups = _groups(folder)
    table = _read_json(folder / "viewer_min_max.json")
    frames: list[_Frame] = []
    for frame_range, first_name in groups:
        for index in frame_range:
            name = str(first_name + index - frame_range.start)
            key = str(index) if str(index) in table and not _named(table, groups) else name
            where = f"{folder / 'viewer_min_max.json'}: frame {key}"
            if key not in table:
                raise StudioError(f"{where} is missing; export or copy the sequence again.")
            frames.append(_Frame(where, table[key]))
    if len({frame.degree for frame in frames}) > 1:
        raise StudioError(f"{folder}: frames have different numbers of attributes; export the sequence again.")
    decoder = _Decoder(folder, [frame_range for frame_range, _ in groups], frames)
    starts: list[int] = []
    for frame_range, _ in groups:  # splats cannot be followed where their number changes within a group
        first = frame_range.start
        starts += [index for index in frame_range if index == first or frames[index].count != frames[index - 1].count]
    return SplatVideo(str(folder), fps, len(frames), tuple(starts), decoder.read, up=np.array([0.0, -1.0, 0.0]))


def _named(table: dict[str, Any], groups: list[tuple[range, int]]) -> bool:
    """Whether frames are called by their names: then not every index is there."""
    return any(str(index) not in table for frame_range, _ in groups for index in frame_range)


def _groups(folder: Path) -> list[tuple[range, int]]:
    """Frames of each group, and the name of the first."""
    path = folder / "group_info.json"
    values = _read_json(path)
    result: list[tuple[range, int]] = []
    expected = 0
    for number in range(len(values)):
        entry: Any = values.get(str(number))
        try:
            first, last = (int(value) for value in entry["frame_index"])
            name = int(entry.get("name_index", [first])[0])
        except (AttributeError, KeyError, TypeError, ValueError, IndexError):
            raise StudioError(f"{path}: group {number} is missing or has no 'frame_index'; export it again.") from None
        if first != expected or last < first or last >= MAX_FRAMES:
            raise StudioError(
                f"{path}: group {number} has the frames {first} to {last}; it must begin at {expected} and not end "
                "before it begins."
            )
        result.append((range(first, last + 1), name))
        expected = last + 1
    if not result:
        raise StudioError(f"{path}: there are no groups; export the sequence again.")
    return result


def _read_json(path: Path) -> dict[str, Any]:
    try:
        values = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise StudioError(f"{path}: the file is missing; give a folder in the VideoGS layout.") from None
    except (OSError, ValueError, RecursionError) as error:
        raise StudioError(f"{path}: this is not readable JSON ({error}); export or copy it again.") from None
    if not isinstance(values, dict):
        raise StudioError(f"{path}: a JSON object is expected; export or copy it again.")
    return values


class _Decoder:
    """Decodes frames in order; going back begins the group again. Thread safe."""

    def __init__(self, folder: Path, groups: list[range], frames: list[_Frame]) -> None:
        self._folder = folder
        self._groups = groups
        self._frames = frames
        self._lock = threading.Lock()
        self._group = -1
        self._next = 0
        self._channels: list[Iterator[np.ndarray]] = []

    def read(self, index: int) -> Gaussians:
        """The frame, float32."""
        with self._lock:
            group = next(number for number, frame_range in enumerate(self._groups) if index in frame_range)
            if group != self._group or index < self._next:
                self._open(group)
            try:
                while True:
                    planes = [next(channel) for channel in self._channels]
                    self._next += 1
                    if self._next > index:
                        break
            except BaseException:
                self._group = -1
                raise
        return _gaussians(self._frames[index], planes, f"{self._folder} frame {index}")

    def _open(self, group: int) -> None:
        for channel in self._channels:
            channel.close()  # type: ignore[attr-defined]  # a generator
        place = self._folder / f"group{group}"
        count = len(self._frames[self._groups[group].start].ranges) + 3
        self._channels = [_pictures(place / f"{channel}.mp4") for channel in range(count)]
        self._group, self._next = group, self._groups[group].start


def _pictures(path: Path) -> Iterator[np.ndarray]:
    """The video's pictures as full-range luma, flat uint8."""
    import av

    try:
        with av.open(str(path), "r", format="mp4") as container:
            for frame in container.decode(video=0):
                height, width = frame.height, frame.width
                plane: Any = frame.planes[0]
                luma = np.frombuffer(plane, np.uint8).reshape(-1, plane.line_size)[:height, :width]
                if frame.format.name.startswith("yuvj") or frame.color_range == _JPEG_RANGE:
                    yield luma.ravel()
                elif frame.format.name.startswith(("yuv", "gray")) and frame.format.components[0].bits == 8:
                    yield np.clip(np.rint((luma.ravel() - 16.0) * (255 / 219)), 0, 255).astype(np.uint8)
                else:
                    raise StudioError(f"{path}: pixel format {frame.format.name} cannot be read; export 8-bit YUV.")
    except FileNotFoundError:
        raise StudioError(f"{path}: the file is missing; export or copy the sequence again.") from None
    except (av.error.FFmpegError, IndexError, ValueError, OSError) as error:
        raise StudioError(f"{path}: this is not a readable video ({error}); export or copy it again.") from None
    raise StudioError(f"{path}: the video ends before its group does; export or copy it again.")


def _gaussians(frame: _Frame, planes: list[np.ndarray], where: str) -> Gaussians:
    for channel, plane in enumerate(planes):
        if plane.size < frame.count:
            raise StudioError(f"{where}: channel {channel} has {plane.size} pixels for {frame.count} splats.")
    codes = [plane[: frame.count].astype(np.float64) for plane in planes]
    levels = [(codes[2 * axis] + 256 * codes[2 * axis + 1]) / 65535 for axis in range(3)]
    levels += [code / 255 for code in codes[6:]]
    low, high = frame.ranges.T
    values = np.stack(levels) * (high - low)[:, None] + low[:, None]
    data = torch.from_numpy(values.astype(np.float32))
    return Gaussians.from_activated(
        means=data[:3].T.contiguous(),
        sh=data[6:-8].T.reshape(frame.count, -1, 3).contiguous(),
        opacities=data[-8].contiguous(),
        scales=data[-7:-4].T.contiguous(),
        quats=data[-4:].T.contiguous(),
    )
