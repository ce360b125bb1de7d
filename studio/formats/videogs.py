"""The file layout of the paper's released players ("VideoGS layout"), written.

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

In `viewer_min_max.json`, frames are numbered from 0; the released baker numbers them as in the footage.
"""

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from v3studio.studio.errors import StudioError
from v3studio.studio.formats.placing import new_folder
from v3studio.studio.formats.rigid_motion import scaled
from v3studio.studio.gaussians import Gaussians
from v3studio.studio.progress import ProgressFn, no_progress
from v3studio.studio.splat_video import SplatVideo
from v3studio.studio.stream.layout import component_frames, plane_side
from v3studio.studio.stream.morton import morton_order
from v3studio.studio.stream.video import PlaneEncoder, encoding

POSITIONS, NORMALS = 3, 3
QP_KNEE = 22  # above this QP the paper keeps color, scale and rotation at it ("Compression QP Setting")
_OPACITY = -8  # its index among the attributes


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
