"""Decoder of a group, the exact inverse of `encode.group`: one video and a side file to Gaussians."""

import zlib
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from v3studio.studio.errors import StudioError
from v3studio.studio.gaussians import Gaussians
from v3studio.studio.rasterizer.kernels import kernels_for
from v3studio.studio.rotations import quat_multiply
from v3studio.studio.stream.attributes import ATTRIBUTES, BY_NAME, channel_rows
from v3studio.studio.stream.manifest import Rendition, VideoEntry
from v3studio.studio.stream.morton import square_scan
from v3studio.studio.stream.motion_state import MotionState, Side
from v3studio.studio.stream.shapes import shape_axes
from v3studio.studio.stream.sources.source import damaged
from v3studio.studio.stream.video import PlaneDecoder

_KERNEL = ("means", "scales", "opacities", "sh")  # attributes whose channels `dequantize` reads, in its order


class GroupTables:
    """The parsed side file, and the pixel of each number of a splat. Raises ValueError: not as in the manifest."""

    def __init__(self, group: Rendition, data: bytes) -> None:
        self.group = group
        side = Side.parse(data, group)
        self.state = MotionState(group.positions, group.blocks, side, np.float32)
        self.gains = np.ldexp(np.float32(1), side.classes.astype(np.int32))
        pixels = square_scan(group.tile, group.splats)
        width = group.size[0]
        rows, columns = np.divmod(pixels, group.tile)
        self.first = [
            (c // group.columns) * group.tile * width + (c % group.columns) * group.tile
            for c in range(len(group.channels))
        ]
        self.pixels = rows * width + columns
        escapes = side.escapes
        order = np.lexsort((escapes.splat, escapes.channel, escapes.frame))
        self._escapes = (escapes.channel[order], escapes.splat[order], escapes.code[order].astype(np.float32))
        self._starts = np.searchsorted(escapes.frame[order], np.arange(group.frame_count + 1))
        self._steps = np.array([entry.step for entry in group.channels], dtype=np.float32)
        self._offsets = np.array([entry.offset - 128 * entry.step for entry in group.channels], dtype=np.float32)
        rows_of = channel_rows(group.sh_degree)
        read = [rows_of[name] for name in _KERNEL]
        self._read = np.concatenate([np.arange(part.start, part.stop) for part in read])
        self._inputs = {  # as the kernel takes them
            "pixels": self.pixels.astype(np.int32),
            "first": np.array(self.first, dtype=np.int64)[self._read],
            "steps": self._steps[self._read],
            "offsets": self._offsets[self._read],
            "labels": side.labels.astype(np.int32),
        }

    def gaussians(self, index: int, picture: np.ndarray, threads: int = 1) -> Gaussians:
        """Splats of frame `index` of the group, by one pass of the C++ kernel, or `gaussians_numpy` if there is none.

        Opacities differ by rounding; all else has the same bits. More than one thread helps where nothing else decodes.
        """
        group = self.group
        kernels = kernels_for(torch.empty(0))
        if kernels is None:
            return self.gaussians_numpy(index, picture)
        empty, size = kernels.empty_float, (group.splats, group.sh_degree)
        made = {BY_NAME[name].tensor: empty(BY_NAME[name].tensor_shape(*size)) for name in ("quats", *_KERNEL)}
        results = {"logits" if name == "logit_opacities" else name: tensor for name, tensor in made.items()}
        turned = self.state.rotations(index)
        turned = turned if turned is None else np.ascontiguousarray(turned)
        begin, end = self._starts[index : index + 2]
        channel, splat, code = (part[begin:end] for part in self._escapes)
        low, high = (np.searchsorted(channel, self._read, side) for side in ("left", "right"))
        escapes = np.concatenate([np.arange(*ends) for ends in zip(low, high, strict=True)])
        kernels.dequantize(
            picture=np.ascontiguousarray(picture), **self._inputs,
            escape_starts=np.concatenate([[0], np.cumsum(high - low)]), escape_splats=splat[escapes].astype(np.int32),
            escape_codes=code[escapes], gains=self.gains, keyframe=self.state.keyframe,
            local=self.state.blocks.local, maps=self.state.maps(index), rotations=turned,
            **results, threads=threads,
        )  # fmt: skip
        return self._completed(made, index, picture)

    def gaussians_numpy(self, index: int, picture: np.ndarray) -> Gaussians:
        """`gaussians` in plain NumPy. This is the definition."""
        means = self.state.positions(index) + (self.values(index, picture, "means") * self.gains).T
        quats, log_scales = shape_axes(self.values(index, picture, "scales"))
        turned = self.state.rotations(index)
        if turned is not None:
            quats = quat_multiply(turned[self.state.labels], quats)
        arrays = {"means": means, "quats": quats, "log_scales": log_scales}
        return self._completed({name: torch.from_numpy(array) for name, array in arrays.items()}, index, picture)

    def _completed(self, tensors: dict[str, Tensor], index: int, picture: np.ndarray) -> Gaussians:
        """Gaussians of these tensors and of all other attributes, which need nothing but their own channels."""
        for attribute in ATTRIBUTES:
            if attribute.tensor not in tensors:
                columns = np.ascontiguousarray(attribute.from_channels(self.values(index, picture, attribute.name)).T)
                values = attribute.inverse(columns).reshape(len(columns), *attribute.shape)
                tensors[attribute.tensor] = torch.from_numpy(values)
        return Gaussians(**tensors, dilation=self.group.dilation)

    def values(self, index: int, picture: np.ndarray, attribute: str) -> np.ndarray:
        """(C, N) float32 values of an attribute's channels in frame `index` of the group, classes not yet applied."""
        rows = channel_rows(self.group.sh_degree)[attribute]
        flat = picture.reshape(-1)
        values = np.array([flat[first:].take(self.pixels) for first in self.first[rows]], dtype=np.float32)
        begin, end = self._starts[index : index + 2]
        channel, splat, code = (part[begin:end] for part in self._escapes)
        own = slice(*np.searchsorted(channel, (rows.start, rows.stop)))
        values[channel[own] - rows.start, splat[own]] = code[own]
        values *= self._steps[rows, None]
        values += self._offsets[rows, None]
        return values


@dataclass(frozen=True, eq=False)
class DecodedFrame:
    """One frame, decoded but not dequantized: the tables of its group, its index there, and what its video shows,
    (height, width) uint8."""

    tables: GroupTables
    index: int
    picture: np.ndarray

    def gaussians(self) -> Gaussians:
        """The splats in the stream's order (Morton order of the keyframe), float32 on the CPU. Thread safe."""
        return self.tables.gaussians(self.index, self.picture)


class GroupDecoder:
    """Decodes the frames of one group in order; `next_frame`: index in the stream of the one that `read` returns.

    `files`: content by path, from `StreamReader.fetch`; `name`: the stream, for messages; `threads`: of the video's
    decoder. StudioError if a file does not match the manifest.
    """

    def __init__(self, group: Rendition, files: Mapping[str, bytes], name: str, threads: int = 1) -> None:
        self.group, self.next_frame, self._name = group, group.first_frame, name
        path = group.video.path
        self._video = PlaneDecoder(files[path], f"{name}/{path}", group.size, group.frame_count, threads)
        try:
            self._tables = GroupTables(group, files[group.side.path])
        except ValueError as error:
            self.close()
            raise damaged(
                "stream.side_file_damaged", f"the side file is damaged: {error}", f"{name}/{group.side.path}"
            ) from None

    def read(self) -> DecodedFrame:
        """The next frame; call `DecodedFrame.gaussians` on any thread for its splats. StudioError if a file is damaged,
        or there is none."""
        if self.next_frame >= self.group.end_frame:
            problem = f"group {self.group.index} has only {self.group.frame_count} frames"
            raise StudioError("stream.end_of_group", problem, group=self.group.index)
        index = self.next_frame - self.group.first_frame
        picture = np.empty(self.group.size[::-1], dtype=np.uint8)
        self._video.read(picture)
        check_luma(self.group.video, index, picture, self._name)
        self.next_frame += 1
        return DecodedFrame(self._tables, index, picture)

    def close(self) -> None:
        """Release decoder and memory."""
        self._video.close()


def check_luma(video: VideoEntry, index: int, luma: np.ndarray, name: str) -> None:
    """Compare image `index` (0-based) of a video, contiguous uint8 luma, with its check, if it has one."""
    for check in video.checks:
        if check.picture == index and (crc32 := zlib.crc32(luma.data)) != check.crc32:
            raise StudioError(
                "stream.wrong_luma",
                f"picture {index} decodes to other values than the manifest says: the decoder is not exact, or the "
                "manifest is wrong",
                file=f"{name}/{video.path}",
                value=crc32,
                fix="Bake the stream again; if that does not help, install PyAV from PyPI.",
                expected=check.crc32,
                picture=index,
            )
