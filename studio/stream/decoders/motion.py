"""Decoder of the profile `motion`, the exact inverse of `bake_motion`: one video and a side file to Gaussians."""

from collections.abc import Mapping

import numpy as np
import torch

from studio.gaussians import Gaussians
from studio.rasterizer.kernels import kernels_for
from studio.rotations import quat_multiply
from studio.stream.attributes import ATTRIBUTES, channel_rows
from studio.stream.decoders.decoder import DecodedFrame, GroupDecoder, check_luma
from studio.stream.manifest import MotionRendition
from studio.stream.morton import square_scan
from studio.stream.motion_state import MotionState, Side
from studio.stream.shapes import shape_axes
from studio.stream.sources.source import damaged
from studio.stream.video import PlaneDecoder


class GroupTables:
    """The parsed side file, and the pixel of each number of a splat. Raises ValueError: not as in the manifest."""

    def __init__(self, group: MotionRendition, data: bytes) -> None:
        self.group = group
        side = Side.parse(data, group)
        self.state = MotionState(group.positions, group.blocks, side, np.float32)
        self.gains = np.ldexp(np.float32(1), side.classes.astype(np.int32))
        pixels = square_scan(group.tile, group.splats)
        width = group.size[0]
        rows, columns = np.divmod(pixels, group.tile)
        first = [
            (c // group.columns) * group.tile * width + (c % group.columns) * group.tile
            for c in range(len(group.channels))
        ]
        self.pixels = rows * width + columns
        self.first = first
        escapes = side.escapes
        order = np.lexsort((escapes.splat, escapes.channel, escapes.frame))
        self._escapes = (escapes.channel[order], escapes.splat[order], escapes.code[order].astype(np.float32))
        self._starts = np.searchsorted(escapes.frame[order], np.arange(group.frame_count + 1))
        self._steps = np.array([entry.step for entry in group.channels], dtype=np.float32)
        self._offsets = np.array([entry.offset - 128 * entry.step for entry in group.channels], dtype=np.float32)
        self._indices = {  # as the kernel takes them
            "pixels": self.pixels.astype(np.int32),
            "first": np.array(first, dtype=np.int64),
            "labels": side.labels.astype(np.int32),
        }

    def gaussians(self, index: int, picture: np.ndarray, threads: int = 1) -> Gaussians:
        """Splats of frame `index` of the group, in one pass of the C++ kernel; by `gaussians_numpy` if there is none.

        Opacities differ by rounding; all else has the same bits. More than one thread helps where nothing else decodes.
        """
        group = self.group
        kernels = kernels_for(torch.empty(0))
        if kernels is None:
            return self.gaussians_numpy(index, picture)
        shapes = {one.tensor: one.tensor_shape(group.splats, group.sh_degree) for one in ATTRIBUTES}
        found = {name: kernels.empty_float(shape) for name, shape in shapes.items()}
        results = {"logits" if name == "logit_opacities" else name: one for name, one in found.items()}
        turned = self.state.rotations(index)
        turned = turned if turned is None else np.ascontiguousarray(turned)
        begin, end = self._starts[index : index + 2]
        channel, splat, code = (part[begin:end] for part in self._escapes)
        kernels.dequantize(
            picture=np.ascontiguousarray(picture), **self._indices, steps=self._steps, offsets=self._offsets,
            escape_starts=np.searchsorted(channel, np.arange(len(group.channels) + 1)).astype(np.int64),
            escape_splats=splat.astype(np.int32), escape_codes=code, gains=self.gains, keyframe=self.state.keyframe,
            local=self.state.blocks.local, maps=self.state.maps(index), rotations=turned,
            **results, threads=threads,
        )  # fmt: skip
        return Gaussians(**found, dilation=group.dilation)

    def gaussians_numpy(self, index: int, picture: np.ndarray) -> Gaussians:
        """`gaussians` in plain NumPy. This is the definition."""
        values = self.values(index, picture)
        rows = channel_rows(self.group.sh_degree)
        means = self.state.positions(index) + (values[rows["means"]] * self.gains).T
        quats, log_scales = shape_axes(values[rows["scales"]])
        turned = self.state.rotations(index)
        if turned is not None:
            quats = quat_multiply(turned[self.state.labels], quats)
        found = {"means": means, "quats": quats, "log_scales": log_scales}
        for one in ATTRIBUTES:
            if one.tensor not in found:
                columns = np.ascontiguousarray(one.from_channels(values[rows[one.name]]).T)
                found[one.tensor] = one.inverse(columns).reshape(len(means), *one.shape)
        return Gaussians(**{name: torch.from_numpy(one) for name, one in found.items()}, dilation=self.group.dilation)

    def values(self, index: int, picture: np.ndarray) -> np.ndarray:
        """(C, N) float32 values of the channels in frame `index` of the group, classes not yet applied."""
        group = self.group
        flat = picture.reshape(-1)
        values = np.empty((len(group.channels), group.splats), dtype=np.float32)
        for row, first in zip(values, self.first, strict=True):
            row[:] = flat[first:].take(self.pixels)
        begin, end = self._starts[index : index + 2]
        if end > begin:
            channel, splat, code = (part[begin:end] for part in self._escapes)
            values[channel, splat] = code
        for row, step, offset in zip(values, self._steps, self._offsets, strict=True):
            row *= step
            row += offset
        return values


class MotionFrame(DecodedFrame):
    """One frame: image (height, width) uint8 and 0-based index within the group."""

    def __init__(self, tables: GroupTables, index: int, picture: np.ndarray) -> None:
        self.tables, self.index, self.picture = tables, index, picture

    def gaussians(self) -> Gaussians:
        return self.tables.gaussians(self.index, self.picture)


class MotionDecoder(GroupDecoder):
    """Decodes one group of the profile `motion`. Raises StudioError: a file does not match the manifest."""

    def __init__(self, group: MotionRendition, files: Mapping[str, bytes], name: str, codec: str, threads: int) -> None:
        super().__init__(group)
        self._size, self._entry, self._name = group.size, group.video, name
        path, pictures = group.video.path, group.frame_count
        self._video = PlaneDecoder(files[path], f"{name}/{path}", group.size, pictures, codec, threads)
        try:
            self._tables = GroupTables(group, files[group.side.path])
        except ValueError as error:
            self.close()
            raise damaged(
                "stream.side_file_damaged", f"the side file is damaged: {error}", f"{name}/{group.side.path}"
            ) from None

    def _read(self, index: int) -> MotionFrame:
        picture = np.empty(self._size[::-1], dtype=np.uint8)
        self._video.read(picture)
        check_luma(self._entry, index, picture, self._name)
        return MotionFrame(self._tables, index, picture)

    def close(self) -> None:
        self._video.close()
