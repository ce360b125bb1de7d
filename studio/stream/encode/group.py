"""Encoder of a group: keyframe means and block motion in a side file, everything else in one video."""

import math
import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from v3studio.studio.gaussians import Gaussians
from v3studio.studio.progress import ProgressFn
from v3studio.studio.rotations import mrp_to_quats, quat_conjugate, quat_multiply, quats_to_mrp
from v3studio.studio.stream.attributes import ATTRIBUTES, BY_NAME, channel_rows, channels, component_rows
from v3studio.studio.stream.encode.files import named_by_content
from v3studio.studio.stream.encode.paths import carry_hidden_splats, smooth_paths
from v3studio.studio.stream.layout import component_frames, tile_grid, tile_side, typical_size
from v3studio.studio.stream.manifest import (
    BlockTable,
    Box,
    ChannelEntry,
    Lattice,
    Rendition,
    SideEntry,
    VideoEntry,
    point,
)
from v3studio.studio.stream.morton import deinterleave, interleave, square_scan
from v3studio.studio.stream.motion_blocks import Blocks, find_blocks
from v3studio.studio.stream.motion_state import MAX_BITS, MAX_CLASS, Escapes, MotionState, Side, keyframe_bits
from v3studio.studio.stream.settings import BakeSettings
from v3studio.studio.stream.shapes import shapes_of
from v3studio.studio.stream.video import PlaneEncoder, encoding

_USUAL_OPACITY = 0.15  # median of the trained splats for which the steps were tuned
_BLOCK_STEP = 1.5  # times the position step: unit of the affine parameters
_BLOCK_ERROR = 3.0  # times the position step: smaller errors do not justify further blocks
_REFERENCE_QP = 20
_KEYFRAME_STEP = 4.0  # size of a cell of the keyframe's positions, in position steps
_TURN = 0.01  # MRP (2.3 degrees): smaller block rotations are set to zero
_ROTATION_UNIT = 1 / 512
_JITTER = 4.0  # steps (of class 1, for positions): standard deviation of what training adds to each frame, measured
_STEPS_A_SIDE = 127  # range of residual codes in either direction
_TAIL = 1e-4  # fraction of values at either end that may become escapes instead of widening the range
_OUTLIERS = 4  # splats at either end that may do so if they would at least double the step, in channels of any size
_MAX_CODE = float(1 << 30)  # of an escape; the side file has 32 bits


class GroupBake:
    """One group, held in memory, keyframe first. The constructor analyzes it once; `write` can then be called for any
    QP. `progress` is called before each frame, so that it can cancel."""

    def __init__(self, frames: Sequence[Gaussians], progress: ProgressFn) -> None:
        self._count, self._splats, self._degree = len(frames), len(frames[0]), frames[0].sh_degree
        self._dilation = frames[0].dilation
        rows = component_rows(self._degree)
        order: np.ndarray | None = None
        values: list[np.ndarray] = []
        for components in component_frames(frames):
            progress(0, len(frames))
            if order is None:
                order = self._order(components[rows["means"]].T)
            values.append(np.take(components, order, axis=1))
        self._values = np.stack(values)  # (F, C, N) float32
        opacities, scales = self._values[:, rows["opacities"]][:, 0], self._values[:, rows["scales"]]
        positions = self._values[:, rows["means"]].transpose(0, 2, 1).astype(np.float64)
        self._positions = positions = carry_hidden_splats(positions, opacities)
        self._box = Box(min=point(positions.min(axis=(0, 1))), max=point(positions.max(axis=(0, 1))))
        self._typical = typical_size(scales[0], self._extent)
        # opaque splats show shifts more; the square root works best (measured, as in _importance)
        opaque = float(np.clip(np.median(opacities[0]) / _USUAL_OPACITY, 0.25, 16))
        self._step = BY_NAME["means"].steps[0] * self._typical / math.sqrt(opaque)
        self._labels = find_blocks(positions, _BLOCK_ERROR * self._step)
        progress(0, len(frames))
        self._importance = _importance(opacities[0], scales[0].mean(axis=0))
        quats = self._values[:, rows["quats"]].transpose(0, 2, 1).astype(np.float64)
        self._turns = self._block_turns(quats)
        self._unmoving = self._without_turns(quats)

    def _order(self, points: np.ndarray) -> np.ndarray:
        """Morton order of the finest cells, valid for coarser cells too. Sets origin, extent and codes."""
        points = points.astype(np.float64)
        self._origin = points.min(axis=0)
        self._extent = float((points.max(axis=0) - self._origin).max())
        finest = 1 << MAX_BITS
        factor = finest / self._extent if self._extent > 0 else 0.0
        cells = np.clip((points - self._origin) * factor, 0, finest - 1).astype(np.int64)
        codes = interleave(cells)
        order = np.argsort(codes, kind="stable")
        self._codes = codes[order]
        return order

    def _without_turns(self, quats: np.ndarray) -> dict[str, np.ndarray]:
        """(F, C, N) channels of each attribute but the means, as they are in blocks that do not rotate."""
        parts = {name: self._values[:, rows] for name, rows in component_rows(self._degree).items()}
        shapes = np.empty((self._count, 6, self._splats), dtype=np.float32)
        for frame, scales in enumerate(np.exp(parts["scales"])):
            own = quats[frame]
            if frame > 0:
                turned = mrp_to_quats(self._turns[frame - 1].T * _ROTATION_UNIT)
                own = quat_multiply(quat_conjugate(turned)[self._labels], own)
            shapes[frame] = shapes_of(own, scales.T)
        moving = ("means", "quats", "scales")
        others = [attribute for attribute in ATTRIBUTES if attribute.name not in moving]
        return {"scales": shapes} | {other.name: other.to_channels(parts[other.name]) for other in others}

    def write(
        self,
        folder: Path,
        identity: Mapping[str, Any],
        settings: BakeSettings,
        progress: ProgressFn,
        threads: int,
        fps: float,
    ) -> Rendition:
        """Write side file and video into `folder`, under the names of their content; `identity` has the values of the
        rendition that are not known here, `progress` is called with (frames encoded, frames)."""
        coarse = 2.0 ** ((settings.qp - _REFERENCE_QP) / 6)  # 6 QPs double the quantizer step of the codec
        cell = _KEYFRAME_STEP * coarse * self._step
        bits = MAX_BITS if settings.qp == 0 else keyframe_bits(self._extent, cell)
        lattice = Lattice(bits=bits, min=point(self._origin), step=max(self._extent, 1e-9) / (1 << bits))
        codes = self._codes >> np.uint64(3 * (MAX_BITS - bits))
        table, affine = self._motions(codes, lattice, threads)
        residuals = self._residuals(codes, lattice, table, affine)
        attributes = self._unmoving
        if settings.smooths_paths:
            residuals = smooth_paths(residuals, _JITTER * self._step * self._importance, keep_first=True)
            attributes = self._smoothed
        rows_of = channel_rows(self._degree)
        means = rows_of["means"]
        steps = self._channel_steps(settings)
        classes = _classes(self._importance, residuals, steps[means.start])
        gains = np.ldexp(1.0, classes.astype(np.int64))
        entries: list[ChannelEntry] = []
        tile = tile_side(self._splats)
        columns, rows = tile_grid(len(steps))
        pictures = np.full((self._count, rows * tile, columns * tile), 128, dtype=np.uint8)
        scan = square_scan(tile, tile * tile)
        escapes: list[np.ndarray] = []
        parts = {"means": residuals.swapaxes(1, 2), **attributes}
        coded = (values for name in rows_of for values in parts[name].swapaxes(0, 1))
        for index, (channel, step, values) in enumerate(zip(channels(self._degree), steps, coded, strict=True)):
            if means.start <= index < means.stop:
                offset, values = 0.0, values / gains
            else:
                values = values.astype(np.float64)
                offset, step = map(_stored, _channel_range(values, step))
            codes_8 = np.rint((values - offset) / step).astype(np.int64) + 128
            beyond = (codes_8 < 0) | (codes_8 > 255)
            frame, splat = np.nonzero(beyond)
            escapes.append(np.stack([np.full(len(frame), index), splat, frame, codes_8[beyond]]))
            row, column = divmod(index, columns)
            square = np.empty((self._count, tile * tile), dtype=np.uint8)
            square[:, scan[: self._splats]] = np.clip(codes_8, 0, 255)
            square[:, scan[self._splats :]] = square[:, scan[self._splats - 1], None]
            area = pictures[:, row * tile : (row + 1) * tile, column * tile : (column + 1) * tile]
            area[:] = square.reshape(self._count, tile, tile)
            entries.append(ChannelEntry(name=channel, offset=offset, step=step))
        channel_, splat_, frame_, code_ = np.concatenate(escapes, axis=1)
        side = Side(codes, self._labels, classes, affine, self._turns, Escapes(channel_, splat_, frame_, code_))
        data, raw_bytes = side.to_bytes(bits)
        (folder / "motion.bin").write_bytes(data)
        self._encode(pictures, folder / "video.mp4", settings, progress, fps)
        side_entry = SideEntry(**dict(named_by_content(folder / "motion.bin")), raw_bytes=raw_bytes)
        video = VideoEntry.model_construct(**dict(named_by_content(folder / "video.mp4")), qp=settings.qp, checks=())
        return Rendition.model_construct(
            **identity,
            splats=self._splats,
            sh_degree=self._degree,
            bounding_box=self._box,
            bytes=side_entry.bytes + video.bytes,
            dilation=self._dilation,
            tile=tile,
            columns=columns,
            rows=rows,
            positions=lattice,
            blocks=table,
            channels=tuple(entries),
            video=video,
            side=side_entry,
        )

    def _channel_steps(self, settings: BakeSettings) -> list[float]:
        """Step of each channel of `attributes.channels`, before `_channel_range`, in world units.

        Residuals of class 1 have `self._step`, those of class 0 half of it. An attribute whose QP differs from `qp` has
        a finer or coarser step, 6 QPs per factor of two.
        """
        steps: list[float] = []
        qps = {str(name): qp for name, qp in settings.attribute_qps.items()}
        for attribute in map(BY_NAME.__getitem__, channel_rows(self._degree)):
            base = attribute.steps
            if attribute.name == "means":
                base = (self._step / 2,) * 3
            elif attribute.name == "scales":
                base = tuple(step * math.sqrt(self._typical) for step in base)
            qp = qps.get(attribute.name, settings.qp)
            steps += [step * 2.0 ** ((qp - settings.qp) / 6) for step in base] * attribute.repeats(self._degree)
        return steps

    @cached_property
    def _smoothed(self) -> dict[str, np.ndarray]:
        """(F, C, N) float64 channels of each attribute but the means, each channel smoothed on its own."""
        steps, rows = self._channel_steps(BakeSettings()), channel_rows(self._degree)
        smoothed = {}
        for name, values in self._unmoving.items():
            channels = zip(values.swapaxes(0, 1), steps[rows[name]], strict=True)
            paths = [smooth_paths(path[..., None], _JITTER * step, keep_first=False) for path, step in channels]
            smoothed[name] = np.stack([path[..., 0] for path in paths], axis=1)
        return smoothed

    def _encode(
        self, pictures: np.ndarray, path: Path, settings: BakeSettings, progress: ProgressFn, fps: float
    ) -> None:
        size = (pictures.shape[2], pictures.shape[1])
        b_frames = min(settings.b_frame_count, max(self._count - 2, 0))
        encoder = PlaneEncoder(path, size, settings.qp, settings.preset, b_frames, fps)
        with encoding([encoder], threads=1):
            for number, picture in enumerate(pictures):
                encoder.add(picture)
                progress(number + 1, self._count)

    def _residuals(self, codes: np.ndarray, lattice: Lattice, table: BlockTable, affine: np.ndarray) -> np.ndarray:
        """(F, N, 3) differences between the means and where their blocks move them; 0 in the keyframe."""
        empty = np.zeros(0, dtype=np.int64)
        no_classes, no_escapes = np.zeros(self._splats, np.uint8), Escapes(empty, empty, empty, empty)
        state = MotionState(lattice, table, Side(codes, self._labels, no_classes, affine, self._turns, no_escapes))
        residuals = np.zeros((self._count, self._splats, 3))
        for frame in range(1, self._count):
            residuals[frame] = self._positions[frame] - state.positions(frame)
        return residuals

    def _motions(self, codes: np.ndarray, lattice: Lattice, threads: int) -> tuple[BlockTable, np.ndarray]:
        """The block table, and the affine motion of each frame in its units, (F - 1, 12, B) int64."""
        count = int(self._labels.max()) + 1
        cells = deinterleave(codes)
        points = Blocks.over(cells, self._labels, count, lattice.step, 1.0).local[:, :3]
        radius = max(float(np.sqrt((points**2).sum(axis=1).mean())), lattice.step)
        table = BlockTable(count=count, radius=radius, step=_BLOCK_STEP * self._step, rotation_step=_ROTATION_UNIT)
        blocks = Blocks.over(cells, self._labels, count, lattice.step, radius)
        affine = np.zeros((self._count - 1, 12, count), dtype=np.int64)

        def fit(frame: int) -> None:
            maps = blocks.fit(self._positions[frame] - self._positions[0])
            affine[frame - 1] = np.rint(maps.reshape(count, 12).T / table.step)

        with ThreadPoolExecutor(threads or os.cpu_count() or 1, thread_name_prefix="bake") as pool:
            list(pool.map(fit, range(1, self._count)))
        return table, affine

    def _block_turns(self, quats: np.ndarray) -> np.ndarray:
        """Mean rotations of the blocks since the keyframe, (F - 1, 3, B) int64: medians over their splats, whose
        quaternions are (F, N, 4)."""
        turns = np.zeros((self._count - 1, 3, int(self._labels.max()) + 1), dtype=np.int64)
        order = np.argsort(self._labels, kind="stable")
        parts = np.split(order, np.cumsum(np.bincount(self._labels))[:-1])
        for frame in range(1, self._count):
            turn = quat_multiply(quats[frame], quat_conjugate(quats[0]))
            turn *= np.where(turn[:, :1] < 0, -1.0, 1.0)
            mean = np.stack([np.median(turn[part], axis=0) for part in parts])
            mean /= np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), 1e-12)
            numbers = quats_to_mrp(mean)
            numbers[np.linalg.norm(numbers, axis=1) < _TURN] = 0
            turns[frame - 1] = np.rint(numbers / _ROTATION_UNIT).T
        return turns


def _stored(value: float) -> float:
    """A number for the manifest, with 9 significant digits: further ones depend on the kernels that BLAS chooses for a
    processor, and so would the stream's bytes."""
    return float(f"{value:.9g}")


def _importance(opacity: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    """(N,) relative position step, about 1: errors of faint and large splats are less visible (numbers measured)."""
    faint = np.sqrt(np.median(opacity) / np.maximum(opacity, 1e-3))
    large = np.exp(0.3 * (sizes - np.median(sizes)))
    return np.clip(faint * large, 0.5, 4.0)


def _classes(importance: np.ndarray, residuals: np.ndarray, step: float) -> np.ndarray:
    """(N,) uint8 classes by importance, coarse enough for the splat's residuals in 80% of the frames."""
    wanted = np.rint(np.log2(importance)) + 1  # class 0 is the finest
    reach = np.quantile(np.abs(residuals).max(axis=2), 0.8, axis=0)
    needed = np.ceil(np.log2(np.maximum(reach / (_STEPS_A_SIDE * step), 1e-9)))
    return np.clip(np.maximum(wanted, needed), 0, MAX_CLASS).astype(np.uint8)


def _channel_range(values: np.ndarray, step: float) -> tuple[float, float]:
    """Offset and step (at least `step`) of a channel: all values if 255 steps hold them, else all but the tails."""
    least, most = low, high = float(values.min()), float(values.max())
    if high - low > 254 * step:
        low, high = (float(end) for end in np.quantile(values, [_TAIL, 1 - _TAIL]))
        inner = _without_outliers(values)
        if high - low > 2 * max(inner[1] - inner[0], 254 * step):
            low, high = inner
    return (low + high) / 2, max(step, (high - low) / 254, (most - least) / _MAX_CODE)


def _without_outliers(values: np.ndarray) -> tuple[float, float]:
    """Range of the values without a few splats that are far from all others: farther than the range of these."""
    splats = values.reshape(-1, values.shape[-1])
    if splats.shape[1] <= 2 * _OUTLIERS:
        return float(values.min()), float(values.max())
    low = float(np.partition(splats.min(axis=0), _OUTLIERS)[_OUTLIERS])
    high = float(np.partition(splats.max(axis=0), -_OUTLIERS - 1)[-_OUTLIERS - 1])
    width = high - low
    near = splats[(splats >= low - width) & (splats <= high + width)]
    return float(near.min()), float(near.max())
