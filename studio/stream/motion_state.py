"""The side file: everything that is not in the video. Shared by encoder and decoder."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from v3studio.studio.rotations import mrp_to_quats
from v3studio.studio.stream.attributes import MAX_VALUE, value_bounds
from v3studio.studio.stream.manifest import BlockTable, ChannelEntry, Lattice, Rendition
from v3studio.studio.stream.morton import deinterleave
from v3studio.studio.stream.motion_blocks import Blocks
from v3studio.studio.stream.sidefile import Cursor, decode_octree, deflate, encode_octree, inflate, split

MAX_CLASS = 15  # largest class, which has four bits; the step of residuals doubles with each class
MAX_BITS = 16  # largest number of bits per axis of the keyframe's means

_RUN_BYTES = 4
_LABEL_BYTES = 2
_MOTION_BYTES = 4
_ESCAPE_BYTES = 4


@dataclass(frozen=True)
class Escapes:
    """Codes outside of 0 to 255 with their (E,) int64 indices, sorted by channel, splat and frame."""

    channel: np.ndarray
    splat: np.ndarray
    frame: np.ndarray
    code: np.ndarray


@dataclass(frozen=True)
class Side:
    """Content of the side file."""

    codes: np.ndarray  # (N,) uint64 Morton codes of the keyframe's cells, sorted, 3 * bits bits
    labels: np.ndarray  # (N,) int64 block of each splat
    classes: np.ndarray  # (N,) uint8; the residual steps of a splat are 2^class times those of the channel
    # (F - 1, 12, B) int64 affine motion of the blocks in units of `blocks.step`; parameter 3 i + k is row i, column k
    # of the 4 x 3 map
    affine: np.ndarray
    # (F - 1, 3, B) int64 mean rotations since the keyframe as MRP, in units of `blocks.rotation_step`
    rotation: np.ndarray
    escapes: Escapes  # codes outside the range of the video

    def to_bytes(self, bits: int) -> tuple[bytes, int]:
        """The compressed side file and its decompressed size."""
        escapes = self.escapes
        order = np.lexsort((escapes.frame, escapes.splat, escapes.channel))
        channel, splat, frame, code = (getattr(escapes, name)[order] for name in ("channel", "splat", "frame", "code"))
        beyond = np.where(code < 0, code, code - 255)
        parts = [
            *encode_octree(self.codes, bits),
            *_label_runs(self.labels),
            _in_pairs(self.classes),
            *split(_time_differences(self.affine), _MOTION_BYTES),
            *split(_time_differences(self.rotation), _MOTION_BYTES),
            *split(np.array([len(code)]), _ESCAPE_BYTES),
            channel.astype(np.uint8).tobytes(),
            *split(np.diff(splat, prepend=0), _ESCAPE_BYTES),
            *split(np.diff(frame, prepend=0), _ESCAPE_BYTES),
            *split(beyond, _ESCAPE_BYTES),
        ]
        return deflate(parts), sum(map(len, parts))

    @classmethod
    def parse(cls, data: bytes, group: Rendition) -> Side:
        """Inverse of `to_bytes`. Raises ValueError: the bytes do not match the manifest."""
        cursor = Cursor(inflate(data, group.side.raw_bytes))
        splats, blocks, moved = group.splats, group.blocks.count, group.frame_count - 1
        codes = decode_octree(cursor, group.positions.bits, splats)
        labels = _from_label_runs(cursor, splats)
        if labels.min() < 0 or labels.max() >= blocks:
            raise ValueError("a splat belongs to a nonexistent block")
        pairs = cursor.take((splats + 1) // 2)
        classes = np.stack([pairs & 15, pairs >> 4], axis=1).reshape(-1)[:splats]
        affine = _from_time_differences(cursor.integers(moved * 12 * blocks, _MOTION_BYTES), (moved, 12, blocks))
        if np.abs(affine).max(initial=0) * group.blocks.step > MAX_VALUE:
            raise ValueError(f"a block moves by more than {MAX_VALUE:g}")
        rotation = _from_time_differences(cursor.integers(moved * 3 * blocks, _MOTION_BYTES), (moved, 3, blocks))
        if np.abs(rotation).max(initial=0) * group.blocks.rotation_step > MAX_VALUE:
            raise ValueError(f"the rotation of a block exceeds {MAX_VALUE:g}")
        count = int(cursor.integers(1, _ESCAPE_BYTES)[0])
        if count < 0:
            raise ValueError(f"the number of escapes is {count}")
        channel = cursor.take(count).astype(np.int64)
        splat = np.cumsum(cursor.integers(count, _ESCAPE_BYTES))
        frame = np.cumsum(cursor.integers(count, _ESCAPE_BYTES))
        beyond = cursor.integers(count, _ESCAPE_BYTES)
        if len(cursor.rest):
            raise ValueError(f"{len(cursor.rest)} unexpected bytes at the end")
        for values, limit in ((channel, len(group.channels)), (splat, splats), (frame, moved + 1)):
            if count and (values.min() < 0 or values.max() >= limit):
                raise ValueError("an escape is outside the group")
        if (np.diff((channel * splats + splat) * group.frame_count + frame) <= 0).any():
            raise ValueError("the escapes are not in order, or two are of one value")
        code = np.where(beyond < 0, beyond, beyond + 255)
        _check_values(group.channels, channel, code)
        return cls(codes, labels, classes, affine, rotation, Escapes(channel, splat, frame, code))


_MOST_CODES = 1 << 31  # codes are signed numbers of 32 bits in players


def _label_runs(labels: np.ndarray) -> list[bytes]:
    """Labels as runs: their lengths, and how each differs from the run before it; 0: it is as the one before that."""
    starts = np.flatnonzero(np.diff(labels, prepend=-1))
    lengths = np.diff(starts, append=len(labels))
    own = labels[starts]
    before, earlier = (np.concatenate([np.zeros(k, np.int64), own])[: len(own)] for k in (1, 2))
    changes = np.where(own == earlier, 0, own - before)
    return [*split(np.array([len(starts)]), _RUN_BYTES), *split(lengths - 1, _RUN_BYTES), *split(changes, _LABEL_BYTES)]


def _from_label_runs(cursor: Cursor, splats: int) -> np.ndarray:
    """Inverse of `_label_runs`: (splats,) int64. Raises ValueError if the runs do not have so many splats."""
    count = int(cursor.integers(1, _RUN_BYTES)[0])
    if not 1 <= count <= splats:
        raise ValueError(f"the number of runs of labels is {count}")
    lengths = cursor.integers(count, _RUN_BYTES) + 1
    if lengths.min() < 1 or lengths.sum() != splats:
        raise ValueError("the runs of labels do not match the number of splats")
    own, before, earlier = [], 0, 0
    for change in cursor.integers(count, _LABEL_BYTES).tolist():
        before, earlier = (earlier if change == 0 else before + change), before
        own.append(before)
    return np.repeat(np.array(own), lengths)


def _in_pairs(classes: np.ndarray) -> bytes:
    """Classes as four bits, two in a byte: there are few, and a Huffman code has at least one bit for each byte."""
    pairs = np.zeros((len(classes) + 1) // 2 * 2, dtype=np.uint8)
    pairs[: len(classes)] = classes
    return (pairs[::2] | pairs[1::2] << 4).tobytes()


def _time_differences(values: np.ndarray) -> np.ndarray:
    """Second differences over the first axis, with two zeros before it: small for steady motion."""
    return np.diff(values, n=2, axis=0, prepend=np.zeros((2, *values.shape[1:]), dtype=np.int64))


def _from_time_differences(values: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    result: np.ndarray = np.cumsum(np.cumsum(values.reshape(shape), axis=0), axis=0)
    return result


def _check_values(channels: Sequence[ChannelEntry], channel: np.ndarray, code: np.ndarray) -> None:
    """Raises ValueError for an escape whose value is out of the bounds of its channel, which cannot be drawn."""
    bounds = np.array([(entry.offset, entry.step, *value_bounds(entry.name)) for entry in channels])
    offset, step, low, high = bounds[channel].T
    values = offset + (code - 128) * step
    wrong = np.flatnonzero((values < low) | (values > high) | (code >= _MOST_CODES))
    if len(wrong):
        first = wrong[0]
        raise ValueError(f"an escape in {channels[channel[first]].name} has the value {values[first]:g}")


class MotionState:
    """Splats moved by their blocks, without residuals. Encoder and decoder run the same computation."""

    def __init__(self, lattice: Lattice, table: BlockTable, side: Side, dtype: type = np.float64) -> None:
        cells = deinterleave(side.codes)
        self.keyframe: np.ndarray = (np.array(lattice.min) + (cells + 0.5) * lattice.step).astype(dtype)
        self.labels = side.labels
        self._side, self._table = side, table
        self.blocks = Blocks.over(cells, side.labels, table.count, lattice.step, table.radius, dtype)

    def positions(self, index: int) -> np.ndarray:
        """(N, 3) means of the keyframe, moved by the affine motion of the blocks to frame `index` of the group."""
        maps = self.maps(index)
        return self.keyframe if maps is None else np.asarray(self.keyframe + self.blocks.displace(maps))

    def maps(self, index: int) -> np.ndarray | None:
        """(B, 4, 3) affine motion of the blocks since the keyframe; None for the keyframe itself."""
        if index == 0:
            return None
        maps = (self._side.affine[index - 1].T * self._table.step).reshape(-1, 4, 3)
        return np.ascontiguousarray(maps.astype(self.keyframe.dtype))

    def rotations(self, index: int) -> np.ndarray | None:
        """(B, 4) mean rotations since the keyframe; None if no block rotates."""
        if index == 0 or not self._side.rotation[index - 1].any():
            return None
        return mrp_to_quats(self._side.rotation[index - 1].T * self._table.rotation_step).astype(self.keyframe.dtype)


def keyframe_bits(extent: float, step: float) -> int:
    """Smallest number of bits, 1 to 16, at which the keyframe's cells are at most `step` wide."""
    return min(max(math.ceil(math.log2(max(extent / step, 1))), 1), MAX_BITS) if step > 0 else MAX_BITS
