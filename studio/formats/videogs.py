"""The file layout of the paper's released players ("VideoGS layout"), read and written.

    group_info.json      {"0": {"frame_index": [0, 19], "name_index": [0, 19]}, ...}     first and last, inclusive
    viewer_min_max.json  {"0": {"num": N, "info": [min, max, min, max, ...]}, ...}       by frame, counted from 0
    group<g>/<c>.mp4     one H.264 file per channel

Attributes in the order of a 3DGS PLY: x y z, normals, f_dc, f_rest, opacity, scales, rotation, activated (linear scale,
opacity 0 to 1, unit quaternion wxyz). Channels 2 i and 2 i + 1 are the low and high byte of position i; attribute
a >= 3 is channel a + 3. Row-major squares with a side that is a multiple of 8, padded with 0; minimum, maximum and
number of splats are per frame.

One of the players draws the padding, too. Its opacity must therefore decode to less than 1/255, below which players
draw nothing. A lossy codec does not keep it at 0: next to opaque splats H.264's deblocking filter alone makes up to 58
of 255 of it at QP 20 (measured). So opacities are quantized here, by the step that the codec has at the QP, and coded
without loss: code 0 is opacity 0, and padding is exactly that.

In `viewer_min_max.json`, the released baker numbers frames as in the footage and ours numbers them from 0; both are
read.
"""

import json
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from v3studio.studio.bounded_files import TextError, parse_json, read_bounded
from v3studio.studio.errors import StudioError
from v3studio.studio.formats import DEFAULT_FPS
from v3studio.studio.formats.checks import damaged
from v3studio.studio.formats.placing import new_folder
from v3studio.studio.formats.rigid_motion import scaled
from v3studio.studio.gaussians import Gaussians
from v3studio.studio.json_types import JsonObject
from v3studio.studio.own_frame import frame_sentence, splats_frame
from v3studio.studio.progress import ProgressFn, no_progress
from v3studio.studio.splat_video import SplatVideo
from v3studio.studio.stream.layout import component_frames, plane_side
from v3studio.studio.stream.morton import morton_order
from v3studio.studio.stream.video import PlaneEncoder, encoding

POSITIONS, NORMALS = 3, 3
QP_KNEE = 22  # above this QP the paper keeps color, scale and rotation at it ("Compression QP Setting")
_OPACITY = -8  # its index among the attributes

MAX_FRAMES = 1_000_000
MAX_SPLATS = 4 << 20
_ATTRIBUTES = (17, 26, 41, 62)  # their number, by SH degree
_JPEG_RANGE = 2  # FFmpeg's number for full range: luma from 0 to 255


def export_videogs(video: SplatVideo, folder: Path, qp: int = 22, progress: ProgressFn = no_progress) -> None:
    """Write the layout described in the module docstring. The folder must not exist, and appears only when it is
    complete.

    QPs (`qp`: 0, lossless, to 51) follow the paper: high bytes of positions are lossless, and the QP of color, scale
    and rotation is at most 22. Opacities are quantized by the step of the QP and then lossless.
    """
    if not 0 <= qp <= 51:
        raise StudioError("export.invalid_qp", f"QP is {qp}; it must be 0 to 51", value=qp)
    groups: dict[str, dict[str, list[int]]] = {}
    frames: dict[str, dict[str, object]] = {}
    with new_folder(folder) as temporary:
        for number, group in enumerate(video.groups):
            place = temporary / f"group{number}"
            place.mkdir()
            encoders: list[PlaneEncoder] = []
            with encoding(encoders) as pool:
                for index, values in zip(group, _attributes(video, group), strict=True):
                    progress(index, video.frame_count)
                    side = plane_side(values.shape[1])
                    if not encoders:
                        encoders += _encoders(place, values.shape[0], side, qp)
                    low, high = _ranges(values, qp)
                    list(pool.map(PlaneEncoder.add, encoders, _planes(values, low, high, side)))
                    placed = np.zeros(len(low))
                    placed[:POSITIONS] = video.original.translation
                    info = np.stack([low + placed, high + placed], axis=1).ravel().tolist()
                    frames[str(index)] = {"num": values.shape[1], "info": info}
            names = [video.number(group[0]), video.number(group[-1])]
            groups[str(number)] = {"frame_index": [group[0], group[-1]], "name_index": names}
        for name, content in (("group_info.json", groups), ("viewer_min_max.json", frames)):
            (temporary / name).write_text(json.dumps(content, indent=1, allow_nan=False) + "\n")
        progress(video.frame_count, video.frame_count)


def _attributes(video: SplatVideo, group: range) -> Iterator[np.ndarray]:
    """(A, N) float32 per frame, activated, in Morton order of the group's first frame, which improves compression."""

    def frames() -> Iterator[Gaussians]:
        for index in group:
            yield scaled(video.read(index), video.original.scale).to("cpu")

    order = morton_order(video.read(group[0]).means.detach().cpu().numpy())
    for values in component_frames(frames(), order):
        normals = np.zeros((NORMALS, values.shape[1]), np.float32)
        scales = np.exp(values[-7:-4])
        yield np.concatenate([values[:POSITIONS], normals, values[POSITIONS:-7], scales, values[-4:]])


def opacity_levels(qp: int) -> int:
    """Largest code of an opacity: as many steps as the codec's own quantizer has in 0 to 255 at that QP.

    That step is 2^((QP - 4) / 6) (H.264 / AVC, 8.5.9); below QP 4 it is finer than the codes.
    """
    return max(1, min(255, round(255 / 2 ** ((qp - 4) / 6))))


def _ranges(values: np.ndarray, qp: int) -> tuple[np.ndarray, np.ndarray]:
    """Values of the codes 0 and 255 of each attribute, (A,) float64: minimum and maximum, except for the opacity.

    Opacities begin at 0, and their largest code is `opacity_levels`, so that 255 stands for more than the maximum.
    """
    low, high = values.min(axis=1).astype(np.float64), values.max(axis=1).astype(np.float64)
    low[_OPACITY] = 0.0
    high[_OPACITY] *= 255 / opacity_levels(qp)
    return low, high


def _encoders(folder: Path, attributes: int, side: int, qp: int) -> list[PlaneEncoder]:
    lossless = {1, 3, 5, attributes + _OPACITY + POSITIONS}  # high bytes of positions, opacities
    result = []
    for channel in range(attributes + POSITIONS):
        value = 0 if channel in lossless else qp if channel < 2 * POSITIONS else min(qp, QP_KNEE)
        result.append(PlaneEncoder(folder / f"{channel}.mp4", (side, side), value, "medium"))
    return result


def quantize(values: np.ndarray, low: float, high: float, levels: int) -> np.ndarray:
    """Round finite values to uint16 codes of `levels` + 1 (256 or 65536) equally spaced levels from `low` to `high`.
    Values outside are clamped; if the range is empty, all codes are 0."""
    if high <= low:
        return np.zeros(values.shape, dtype=np.uint16)
    scaled = (values.astype(np.float64) - low) * (levels / (high - low))
    return np.clip(np.rint(scaled), 0, levels).astype(np.uint16)


def _planes(values: np.ndarray, low: np.ndarray, high: np.ndarray, side: int) -> Iterator[np.ndarray]:
    """One (side, side) uint8 image per channel."""

    def picture(codes: np.ndarray) -> np.ndarray:
        plane = np.zeros(side * side, np.uint8)
        plane[: len(codes)] = codes
        return plane.reshape(side, side)

    for row in range(len(values)):
        if row < POSITIONS:
            codes = quantize(values[row], low[row], high[row], 65535)
            yield picture(codes & 255)
            yield picture(codes >> 8)
        else:
            yield picture(quantize(values[row], low[row], high[row], 255))


def is_videogs(folder: Path) -> bool:
    """Return whether a folder contains the two JSON files of the layout."""
    return (folder / "group_info.json").is_file() and (folder / "viewer_min_max.json").is_file()


@dataclass(frozen=True, eq=False)
class _Frame:
    """An entry of viewer_min_max.json: number of splats, and (A, 2) minimum and maximum of each attribute."""

    count: int
    ranges: np.ndarray


def _frame(path: Path, key: str, entry: Any) -> _Frame:
    """A validated entry."""

    def invalid(name: str, problem: str, value: Any = None) -> StudioError:
        return damaged("videogs.invalid_frame", f"frame {key}: {problem}", path, value, frame=key, name=name)

    count, info = (entry.get("num"), entry.get("info")) if isinstance(entry, dict) else (None, None)
    if not isinstance(count, int) or isinstance(count, bool) or not 0 < count <= MAX_SPLATS:
        raise invalid("num", f"'num' is {count!r}; it must be an integer from 1 to {MAX_SPLATS}", count)
    try:
        ranges = np.array(info, np.float64).reshape(-1, 2)
    except (TypeError, ValueError):
        raise invalid("info", "'info' must be a list of minima and maxima") from None
    if len(ranges) not in _ATTRIBUTES:
        raise invalid("info", f"'info' has {2 * len(ranges)} values; expected 34, 52, 82 or 124", 2 * len(ranges))
    if not np.isfinite(ranges).all() or (ranges[:, 0] > ranges[:, 1]).any():
        raise invalid("info", "'info' contains a value that is not finite, or a minimum above its maximum")
    return _Frame(count, ranges)


def open_videogs(folder: Path, fps: float = DEFAULT_FPS) -> SplatVideo:
    """Open a folder in this layout as a video. Frames are decoded when read; sequential reading is fastest. StudioError
    if a JSON file is missing or damaged, there are gaps between groups, values are out of bounds, or (when reading a
    frame) a video is missing, damaged or too short."""
    groups = _groups(folder)
    path = folder / "viewer_min_max.json"
    table = _read_json(path)
    # otherwise keys are frame numbers of the footage, so that some indices are missing
    by_index = all(str(index) in table for frame_range, _ in groups for index in frame_range)
    frames: list[_Frame] = []
    for frame_range, first_name in groups:
        for index in frame_range:
            key = str(index if by_index else first_name + index - frame_range.start)
            if key not in table:
                raise damaged("videogs.missing_frame", f"frame {key} is missing", path, frame=key)
            frames.append(_frame(path, key, table[key]))
    if len({len(frame.ranges) for frame in frames}) > 1:
        raise damaged("videogs.mixed_degrees", "frames have different numbers of attributes", folder)
    boxes = np.stack([frame.ranges[:POSITIONS] for frame in frames])
    radius = float(np.median(np.ptp(boxes, axis=2).max(axis=1))) / 2
    place = splats_frame(np.median(boxes.mean(axis=2), axis=0), radius)
    for frame in frames:
        frame.ranges[:POSITIONS] = place.scale * frame.ranges[:POSITIONS] + place.translation[:, None]
        frame.ranges[-7:-4] *= place.scale
    decoder = _Decoder(folder, [frame_range for frame_range, _ in groups], frames)
    starts: list[int] = []
    for frame_range, _ in groups:  # a new group starts where the number of splats changes within a group
        first = frame_range.start
        starts += [index for index in frame_range if index == first or frames[index].count != frames[index - 1].count]
    up, notes = np.array([0.0, -1.0, 0.0]), tuple(filter(None, [frame_sentence(place, "stream", "splats")]))
    return SplatVideo(
        str(folder), fps, len(frames), tuple(starts), decoder.read, up=up, notes=notes, original=place.inverse
    )


def _groups(folder: Path) -> list[tuple[range, int]]:
    """The frames of each group, and the footage number of its first frame."""
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
            raise damaged(
                "videogs.invalid_group", f"group {number} is missing or has no 'frame_index'", path, group=number
            ) from None
        if first != expected or last < first or last >= MAX_FRAMES:
            problem = (
                f"group {number} has frames {first} to {last}; it must start at frame {expected} and not end before it"
            )
            raise damaged("videogs.invalid_group", problem, path, (first, last), group=number, expected=expected)
        result.append((range(first, last + 1), name))
        expected = last + 1
    if not result:
        raise damaged("videogs.no_groups", "the file contains no groups", path)
    return result


def _read_json(path: Path) -> JsonObject:
    try:
        values = parse_json(read_bounded(path))
    except FileNotFoundError:
        fix = "Specify a folder in the VideoGS layout."
        raise StudioError("videogs.file_missing", "the file is missing", file=path, fix=fix) from None
    except (OSError, TextError) as error:
        raise damaged("videogs.not_json", f"not valid JSON ({error})", path) from None
    if not isinstance(values, dict):
        raise damaged("videogs.not_json", "not a JSON object", path)
    return values


class _Decoder:
    """Decodes frames in order; seeking backward restarts the group. Thread safe."""

    def __init__(self, folder: Path, groups: list[range], frames: list[_Frame]) -> None:
        self._folder = folder
        self._groups = groups
        self._frames = frames
        self._lock = threading.Lock()
        self._group = -1
        self._next = 0
        self._channels: list[Iterator[np.ndarray]] = []

    def read(self, index: int) -> Gaussians:
        """The frame of an index, float32."""
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
        return _gaussians(self._frames[index], planes, self._folder / f"group{group}", index)

    def _open(self, group: int) -> None:
        for channel in self._channels:
            channel.close()  # type: ignore[attr-defined]  # a generator
        place = self._folder / f"group{group}"
        count = len(self._frames[self._groups[group].start].ranges) + 3
        self._channels = [_pictures(place / f"{channel}.mp4") for channel in range(count)]
        self._group, self._next = group, self._groups[group].start


def _pictures(path: Path) -> Iterator[np.ndarray]:
    """The images of a video as full-range luma, flattened, uint8."""
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
                    problem = f"unsupported pixel format {frame.format.name}"
                    fix = "Export 8-bit YUV."
                    raise StudioError("videogs.pixel_format", problem, file=path, value=frame.format.name, fix=fix)
    except FileNotFoundError:
        raise damaged("videogs.file_missing", "the file is missing", path) from None
    except (av.error.FFmpegError, IndexError, ValueError, OSError) as error:
        raise damaged("videogs.video_unreadable", f"not a readable video ({error})", path) from None
    raise damaged("videogs.video_too_short", "the video has fewer frames than its group", path)


def _gaussians(frame: _Frame, planes: list[np.ndarray], folder: Path, index: int) -> Gaussians:
    for channel, plane in enumerate(planes):
        if plane.size < frame.count:
            problem, path = f"frame {index} has {plane.size} pixels for {frame.count} splats", folder / f"{channel}.mp4"
            raise damaged("videogs.picture_too_small", problem, path, plane.size, frame=index, expected=frame.count)
    codes = [plane[: frame.count].astype(np.float64) for plane in planes]
    levels = [(codes[2 * axis] + 256 * codes[2 * axis + 1]) / 65535 for axis in range(3)]
    levels += [code / 255 for code in codes[6:]]
    low, high = frame.ranges.T
    values = np.stack(levels) * (high - low)[:, None] + low[:, None]
    data = torch.from_numpy(values.astype(np.float32))
    return Gaussians.from_activated(
        means=data[:3].T.contiguous(),
        sh=data[6:-8].T.reshape(frame.count, -1, 3).contiguous(),
        opacities=data[_OPACITY].contiguous(),
        scales=data[-7:-4].T.contiguous(),
        quats=data[-4:].T.contiguous(),
    )
